#include "inceres/io/g2o.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <unordered_map>
#include <unordered_set>

#include "base/sort_unique.h"
#include "io/pose_graph.h"
#include "io/record_reader.h"

// The reader of pose graphs in g2o's text format (docs/file_formats.md, "g2o"). Lines may come in
// any order, and edges and FIX lines may name vertices that follow: so edges are kept with their
// ids and their lines while the file is read, and ids become dense indices at the end (ResolveIds),
// where a vertex that never came is reported with the line that named it. Vertices are numbered by
// their order in the file, edges by theirs.
//
// The first pose record decides between plane and space; everything after it has to be of that
// kind.

namespace inceres {
namespace internal {
namespace {

// What messages call the numbers of a pose.
constexpr const char* kPoseFields2d[] = {"x", "y", "theta"};
constexpr const char* kPoseFields3d[] = {"x", "y", "z", "qx", "qy", "qz", "qw"};

class G2oReader : private RecordReader {
 public:
  using RecordReader::RecordReader;

  Status Read(PoseGraph* graph) {
    // ForEachTaggedLine reads the tags, skips comments and refuses what a record leaves unread in
    // its line.
    graph_ = graph;
    if (ForEachTaggedLine([this] { return ReadRecord(); })) {
      Resolve();
    }
    return status_;
  }

 private:
  // An edge or FIX names vertices by their ids in the file, which may come later.
  struct PendingEdge {
    std::int64_t from, to, line;
  };
  struct PendingFix {
    std::int64_t id, line;
  };

  bool Resolve() {
    // FIX lines alone make no graph.
    if (graph_->ids.empty() && pending_edges_.empty()) {
      return FailAt(scanner_.line(), "the file has no vertices");
    }
    // Some data sets have measurements only: vertices are then those that edges name, and get start
    // values along the edges, for which indices have to be resolved first.
    const bool edges_only = graph_->ids.empty();
    if (edges_only) {
      NameVerticesOfEdges();
    }
    return ResolveIds() && (!edges_only || PlaceVertices());
  }

  // The rest of a line whose tag has been read.
  bool ReadRecord() {
    if (tag_ == "FIX") {
      return ReadFix();
    }
    // FIX is of no dimension: it may stand before the first pose.
    const bool vertex = tag_ == "VERTEX_SE2" || tag_ == "VERTEX_SE3:QUAT";
    // Unknown tags are refused and not skipped: landmarks or parameters left out would give another
    // problem.
    if (!vertex && tag_ != "EDGE_SE2" && tag_ != "EDGE_SE3:QUAT") {
      return Fail(
          "tag",
          "not known; known are VERTEX_SE2, EDGE_SE2, VERTEX_SE3:QUAT, EDGE_SE3:QUAT and FIX");
    }
    const int dimension = tag_.find("SE2") != std::string::npos ? 2 : 3;
    if (graph_->dimension != 0 && graph_->dimension != dimension) {
      return Fail("tag", "planar and spatial poses in one file");
    }
    // Before any field is read: PoseSize and TangentSize follow from it.
    graph_->dimension = dimension;
    return vertex ? ReadVertex() : ReadEdge();
  }

  // One id or several in a line.
  bool ReadFix() {
    // AtEnd tells the end of the line here, since the scanner stays in it.
    do {
      std::int64_t id = 0;
      if (!ReadId("id", &id)) {
        return false;
      }
      fixed_.push_back({id, scanner_.line()});
    } while (!scanner_.AtEnd());
    return true;
  }

  bool ReadVertex() {
    std::int64_t id = 0;
    if (!ReadId("id", &id)) {
      return false;
    }
    // The index it will have; ids need not be dense, nor in order.
    if (!index_of_id_.emplace(id, graph_->NumVertices()).second) {
      return Fail("id", "vertex " + std::to_string(id) + " is in the file twice");
    }
    // Room for either kind; the graph takes PoseSize() of it.
    std::array<double, 7> pose{};
    if (!ReadPose(&pose)) {
      return false;
    }
    graph_->ids.push_back(id);
    graph_->poses.insert(graph_->poses.end(), pose.begin(), pose.begin() + graph_->PoseSize());
    return true;
  }

  // ids in PendingEdge, the rest in the graph: both lists have edge i at i.
  bool ReadEdge() {
    PendingEdge pending{0, 0, scanner_.line()};
    if (!ReadId("from", &pending.from) || !ReadId("to", &pending.to)) {
      return false;
    }
    // Such an edge would have one variable in both of its slots, which no factor may.
    if (pending.from == pending.to) {
      return Fail("to", "an edge from vertex " + std::to_string(pending.to) + " to itself");
    }
    PoseGraphEdge edge;
    if (!ReadPose(&edge.measurement) || !ReadInformation(&edge.information)) {
      return false;
    }
    graph_->edges.push_back(edge);
    pending_edges_.push_back(pending);
    return true;
  }

  // For vertices and for measurements, which look the same.
  bool ReadPose(std::array<double, 7>* pose) {
    const char* const* fields = graph_->dimension == 2 ? kPoseFields2d : kPoseFields3d;
    for (int k = 0; k < graph_->PoseSize(); ++k) {
      if (!scanner_.ScanDouble(&(*pose)[static_cast<std::size_t>(k)])) {
        return Missing(fields[k]);
      }
    }
    return graph_->dimension == 2 || NormalizeQuaternion(pose->data() + 3);
  }

  // Files print a few digits, and factors take quaternions for unit ones. Written so that a NaN is
  // refused too.
  bool NormalizeQuaternion(double* q) {
    const double norm = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    if (!(norm > 1e-12) || !std::isfinite(norm)) {
      return Fail("quaternion", "its length is " + std::to_string(norm));
    }
    std::for_each(q, q + 4, [norm](double& value) { value /= norm; });
    return true;
  }

  // The upper triangle, row by row, mirrored into the full matrix. That it is positive definite is
  // checked where it becomes a factor, where the caller can have it projected instead; a negative
  // diagonal is a broken file.
  bool ReadInformation(std::array<double, 36>* information) {
    const std::size_t size = static_cast<std::size_t>(graph_->TangentSize());
    for (std::size_t row = 0; row < size; ++row) {
      for (std::size_t column = row; column < size; ++column) {
        double value = 0.0;
        if (!scanner_.ScanDouble(&value)) {
          return Missing(Cell(row, column));
        }
        // 0 is let through: an edge may say nothing of one coordinate, for those who project.
        if (row == column && value < 0.0) {
          return Fail(Cell(row, column), "negative on the diagonal");
        }
        (*information)[row * size + column] = value;
        (*information)[column * size + row] = value;
      }
    }
    return true;
  }

  // In the order of the ids, which is that of the odometry: PlaceAlongEdges relies on it.
  void NameVerticesOfEdges() {
    for (const PendingEdge& edge : pending_edges_) {
      graph_->ids.insert(graph_->ids.end(), {edge.from, edge.to});
    }
    SortUnique(&graph_->ids);
    for (int i = 0; i < graph_->NumVertices(); ++i) {
      index_of_id_.emplace(graph_->ids[static_cast<std::size_t>(i)], i);
    }
  }

  // `lost` is the first vertex that no edges lead to from the first one.
  bool PlaceVertices() {
    const int lost = PlaceAlongEdges(graph_);
    return lost == graph_->NumVertices() ||
           FailAt(scanner_.line(), "the file has no VERTEX lines, and " + NoWay(*graph_, lost));
  }

  bool ResolveIds() {
    for (std::size_t i = 0; i < pending_edges_.size(); ++i) {
      const PendingEdge& pending = pending_edges_[i];
      // The line has long been left; its tag follows from the dimension.
      const std::string tag = graph_->dimension == 2 ? "EDGE_SE2" : "EDGE_SE3:QUAT";
      if (!Lookup(pending.from, &graph_->edges[i].from)) {
        return UnknownVertex(pending.line, tag + ": from", pending.from);
      }
      if (!Lookup(pending.to, &graph_->edges[i].to)) {
        return UnknownVertex(pending.line, tag + ": to", pending.to);
      }
    }
    // FIX may name a vertex twice; the list has it once, at its first place.
    std::unordered_set<int> seen;
    for (const PendingFix& pending : fixed_) {
      int index = 0;
      if (!Lookup(pending.id, &index)) {
        return UnknownVertex(pending.line, "FIX: id", pending.id);
      }
      if (seen.insert(index).second) {
        graph_->fixed.push_back(index);
      }
    }
    return true;
  }

  // False for an id that no vertex of the file has.
  bool Lookup(std::int64_t id, int* index) const {
    const auto found = index_of_id_.find(id);
    if (found == index_of_id_.end()) {
      return false;
    }
    *index = found->second;
    return true;
  }

  bool UnknownVertex(std::int64_t line, const std::string& field, std::int64_t id) {
    return FailAt(line, field + ": the file has no vertex " + std::to_string(id));
  }

  static std::string Cell(std::size_t row, std::size_t column) {
    return "information(" + std::to_string(row) + ", " + std::to_string(column) + ")";
  }

  PoseGraph* graph_ = nullptr;
  // Looked up in only, never walked through: its order has no part in the result.
  std::unordered_map<std::int64_t, int> index_of_id_;
  std::vector<PendingEdge> pending_edges_;
  std::vector<PendingFix> fixed_;
};

}  // namespace
}  // namespace internal

Status ReadG2o(const std::string& path, PoseGraph* graph, const ReadOptions& options) {
  return internal::ReadFile<internal::G2oReader>(path, graph, options);
}

}  // namespace inceres
