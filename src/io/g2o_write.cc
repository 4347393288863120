#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <numeric>
#include <string>
#include <vector>

#include "inceres/io/g2o.h"
#include "io/byte_sink.h"
#include "io/check_pose_graph.h"
#include "io/text_writer.h"

// Writes pose graphs in g2o's format, which ReadG2o reads, and as trajectories of the TUM RGB-D
// benchmark. Numbers have the shortest form that reads back as the same double; the reader
// normalizes quaternions, which may change their last bits.
//
// A graph comes from a caller and may be anything: it is checked before the file is opened.

namespace inceres {
namespace internal {
namespace {

// A line's last values: the line ends behind them.
void PutValues(const double* values, int count, TextWriter* writer) {
  for (int k = 0; k < count; ++k) {
    writer->Put(values[k], k + 1 == count ? '\n' : ' ');
  }
}

// Tag, ends, measurement, information, as ReadEdge takes them.
void PutG2oEdge(const PoseGraph& graph, const PoseGraphEdge& edge, TextWriter* writer) {
  writer->PutText(graph.dimension == 2 ? "EDGE_SE2 " : "EDGE_SE3:QUAT ");
  writer->Put(graph.ids[static_cast<std::size_t>(edge.from)], ' ');
  writer->Put(graph.ids[static_cast<std::size_t>(edge.to)], ' ');
  for (int k = 0; k < graph.PoseSize(); ++k) {
    writer->Put(edge.measurement[static_cast<std::size_t>(k)], ' ');
  }
  const auto size = static_cast<std::size_t>(graph.TangentSize());
  // The upper triangle; its last row is the single value that ends the line.
  for (std::size_t r = 0; r < size; ++r) {
    for (std::size_t c = r; c < size; ++c) {
      writer->Put(edge.information[r * size + c], r + 1 == size ? '\n' : ' ');
    }
  }
}

// Vertices before what names them: other readers of the format want it so.
void PutG2o(const PoseGraph& graph, TextWriter* writer) {
  for (int i = 0; i < graph.NumVertices(); ++i) {
    writer->PutText(graph.dimension == 2 ? "VERTEX_SE2 " : "VERTEX_SE3:QUAT ");
    writer->Put(graph.ids[static_cast<std::size_t>(i)], ' ');
    PutValues(graph.PoseData(i), graph.PoseSize(), writer);
  }
  // One line each; a file that was read with several ids in a FIX line is written with several
  // lines.
  for (const int vertex : graph.fixed) {
    writer->PutText("FIX ");
    writer->Put(graph.ids[static_cast<std::size_t>(vertex)], '\n');
  }
  for (const PoseGraphEdge& edge : graph.edges) {
    PutG2oEdge(graph, edge, writer);
  }
}

// A trajectory is in the order of time, for which ids stand.
void PutTum(const PoseGraph& graph, TextWriter* writer) {
  std::vector<int> order(graph.ids.size());
  std::iota(order.begin(), order.end(), 0);
  // Of the indices: the graph is const, and in the order of its file.
  std::sort(order.begin(), order.end(), [&graph](int a, int b) {
    return graph.ids[static_cast<std::size_t>(a)] < graph.ids[static_cast<std::size_t>(b)];
  });
  for (const int i : order) {
    const double* pose = graph.PoseData(i);
    writer->Put(graph.ids[static_cast<std::size_t>(i)], ' ');
    if (graph.dimension == 3) {
      PutValues(pose, 7, writer);
    } else {
      // A planar pose in the plane z = 0: a turn about z by θ has the quaternion (0, 0, sin θ/2,
      // cos θ/2).
      const double line[7] = {
          pose[0], pose[1], 0.0, 0.0, 0.0, std::sin(0.5 * pose[2]), std::cos(0.5 * pose[2])};
      PutValues(line, 7, writer);
    }
  }
}

// The two formats differ in `put` only. A failure of the writer leaves the sink unfinished, which
// removes its partial file.
template <typename PutAll>
Status WritePoseGraph(const std::string& path, const PoseGraph& graph, const PutAll& put) {
  Status status = CheckPoseGraph(graph);
  std::unique_ptr<ByteSink> sink;
  status = status.ok() ? OpenByteSink(path, &sink) : status;
  if (!status.ok()) {
    return status;
  }
  TextWriter writer(sink.get());
  put(graph, &writer);
  return writer.Finish();
}

}  // namespace
}  // namespace internal

Status WriteG2o(const std::string& path, const PoseGraph& graph) {
  return internal::WritePoseGraph(path, graph, internal::PutG2o);
}

Status WriteTumTrajectory(const std::string& path, const PoseGraph& graph) {
  return internal::WritePoseGraph(path, graph, internal::PutTum);
}

}  // namespace inceres
