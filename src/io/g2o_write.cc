#include <array>
#include <cstddef>
#include <memory>
#include <string>

#include "inceres/io/g2o.h"
#include "inceres/io/g2o_graph.h"
#include "io/byte_stream.h"
#include "io/pose_graph.h"
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
  for (const int i : VerticesById(graph)) {
    const double* pose = graph.PoseData(i);
    writer->Put(graph.ids[static_cast<std::size_t>(i)], ' ');
    PutValues(graph.dimension == 3 ? pose : InSpace(pose).data(), 7, writer);
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
