// Files of problems as tuples of arrays, which inceres/_files.py names.
#include <string>
#include <vector>

#include "arrays.h"
#include "inceres/io/bal.h"
#include "inceres/io/g2o.h"
#include "inceres/io/keyframes.h"
#include "module.h"

namespace inceres::python {
namespace {

py::array_t<double> Rows(const std::vector<double>& values, py::ssize_t columns) {
  return py::array_t<double>({static_cast<py::ssize_t>(values.size()) / columns, columns},
                             values.data());
}

ReadOptions ToReadOptions(std::int64_t max_unpacked_bytes) {
  if (max_unpacked_bytes < 0) {
    throw py::value_error("max_unpacked_bytes: " + std::to_string(max_unpacked_bytes) +
                          ", expected at least 0");
  }
  ReadOptions options;
  options.max_unpacked_bytes = max_unpacked_bytes;
  return options;
}

template <typename Read, typename Result>
void ReadWithoutGil(const Read& read, const std::string& path, Result* result,
                    std::int64_t max_unpacked_bytes) {
  const ReadOptions options = ToReadOptions(max_unpacked_bytes);
  Status status;
  {
    const py::gil_scoped_release no_gil;
    status = read(path, result, options);
  }
  Check(status);
}

py::tuple ReadBalFile(const std::string& path, std::int64_t max_unpacked_bytes) {
  BalProblem bal;
  ReadWithoutGil([](const std::string& name, BalProblem* to,
                    const ReadOptions& options) { return ReadBal(name, to, nullptr, options); },
                 path, &bal, max_unpacked_bytes);
  std::vector<std::int32_t> cameras, points;
  std::vector<double> pixels;
  for (const BalObservation& seen : bal.observations) {
    cameras.push_back(seen.camera);
    points.push_back(seen.point);
    pixels.insert(pixels.end(), {seen.x, seen.y});
  }
  return py::make_tuple(Rows(bal.cameras, BalProblem::kCameraSize),
                        Rows(bal.points, BalProblem::kPointSize), ToIdArray(cameras),
                        ToIdArray(points), Rows(pixels, 2));
}

void WriteBalFile(const std::string& path, const py::object& cameras, const py::object& points,
                  const py::object& camera_indices, const py::object& point_indices,
                  const py::object& observations) {
  const DoubleArray c = ToMatrix(cameras, "cameras", BalProblem::kCameraSize);
  const DoubleArray p = ToMatrix(points, "points", BalProblem::kPointSize);
  const DoubleArray z = ToMatrix(observations, "observations", 2);
  const auto of_camera = ToIndexList(camera_indices, "camera_indices", 0, c.shape(0));
  const auto of_point = ToIndexList(point_indices, "point_indices", 0, p.shape(0));
  const auto count = static_cast<std::size_t>(z.shape(0));
  if (of_camera.size() != count || of_point.size() != count) {
    throw py::value_error("camera_indices, point_indices: " + std::to_string(of_camera.size()) +
                          " and " + std::to_string(of_point.size()) + " for " +
                          std::to_string(count) + " observations");
  }
  BalProblem bal;
  bal.num_cameras = static_cast<int>(c.shape(0));
  bal.num_points = static_cast<int>(p.shape(0));
  bal.cameras.assign(c.data(), c.data() + c.size());
  bal.points.assign(p.data(), p.data() + p.size());
  for (std::size_t i = 0; i < count; ++i) {
    bal.observations.push_back({of_camera[i], of_point[i], z.data()[2 * i], z.data()[2 * i + 1]});
  }
  Status status;
  {
    const py::gil_scoped_release no_gil;
    status = WriteBal(path, bal);
  }
  Check(status);
}

py::tuple ReadG2oFile(const std::string& path, std::int64_t max_unpacked_bytes) {
  PoseGraph graph;
  ReadWithoutGil(&ReadG2o, path, &graph, max_unpacked_bytes);
  std::vector<std::int32_t> ends;
  std::vector<double> measurements, information;
  const int a = graph.PoseSize(), d = graph.TangentSize();
  for (const PoseGraphEdge& edge : graph.edges) {
    ends.insert(ends.end(), {edge.from, edge.to});
    measurements.insert(measurements.end(), edge.measurement.data(), edge.measurement.data() + a);
    information.insert(information.end(), edge.information.data(), edge.information.data() + d * d);
  }
  const auto num_edges = static_cast<py::ssize_t>(graph.edges.size());
  return py::make_tuple(
      Rows(graph.poses, a), IdArray({num_edges, py::ssize_t{2}}, ends.data()),
      Rows(measurements, a),
      py::array_t<double>({num_edges, static_cast<py::ssize_t>(d), static_cast<py::ssize_t>(d)},
                          information.data()),
      ToIdArray(std::vector<std::int32_t>(graph.fixed.begin(), graph.fixed.end())),
      py::array_t<std::int64_t>(static_cast<py::ssize_t>(graph.ids.size()), graph.ids.data()));
}

py::tuple ReadKeyframesFile(const std::string& path, std::int64_t max_unpacked_bytes) {
  KeyframeSequence sequence;
  ReadWithoutGil(&ReadKeyframes, path, &sequence, max_unpacked_bytes);
  std::vector<double> poses, features, guesses, seen, relative, information;
  std::vector<std::int32_t> anchors, guess_ids, seen_ids, ends;
  for (const KeyframeFeature& feature : sequence.features) {
    anchors.insert(anchors.end(), {feature.anchor, feature.index});
    features.insert(features.end(), {feature.x, feature.y, feature.inverse_depth});
  }
  for (std::size_t i = 0; i < sequence.keyframes.size(); ++i) {
    const Keyframe& keyframe = sequence.keyframes[i];
    const auto number = static_cast<std::int32_t>(i);
    poses.insert(poses.end(), keyframe.pose.begin(), keyframe.pose.end());
    for (const KeyframeDepthGuess& guess : keyframe.depth_guesses) {
      guess_ids.insert(guess_ids.end(), {number, guess.feature});
      guesses.push_back(guess.inverse_depth);
    }
    for (const KeyframeObservation& observation : keyframe.observations) {
      seen_ids.insert(seen_ids.end(), {number, observation.feature});
      seen.insert(seen.end(), {observation.x, observation.y, observation.inverse_depth,
                               observation.information[0], observation.information[1],
                               observation.information[2]});
    }
    for (const KeyframeBetween& between : keyframe.betweens) {
      ends.insert(ends.end(), {number, between.a, between.b});
      relative.insert(relative.end(), between.q_ab.begin(), between.q_ab.end());
      relative.insert(relative.end(), between.p_ab.begin(), between.p_ab.end());
      information.insert(information.end(), between.information.begin(), between.information.end());
    }
  }
  const auto pairs = [](const std::vector<std::int32_t>& ids, py::ssize_t columns) {
    return IdArray({static_cast<py::ssize_t>(ids.size()) / columns, columns}, ids.data());
  };
  return py::make_tuple(Rows(poses, 7), pairs(anchors, 2), Rows(features, 3), pairs(guess_ids, 2),
                        Rows(guesses, 1), pairs(seen_ids, 2), Rows(seen, 6), pairs(ends, 3),
                        Rows(relative, 7), Rows(information, 36));
}

}  // namespace

void BindFiles(py::module_& module) {
  const auto limit = py::arg("max_unpacked_bytes") = 0;
  module.def("read_bal", &ReadBalFile, py::arg("path"), limit);
  module.def("write_bal", &WriteBalFile, py::arg("path"), py::arg("cameras"), py::arg("points"),
             py::arg("camera_indices"), py::arg("point_indices"), py::arg("observations"));
  module.def("read_g2o", &ReadG2oFile, py::arg("path"), limit);
  module.def("read_keyframes", &ReadKeyframesFile, py::arg("path"), limit);
}

}  // namespace inceres::python
