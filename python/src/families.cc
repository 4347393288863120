// The built-in families: what a row of measurements is to each.
#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <pybind11/stl.h>

#include "arrays.h"
#include "family.h"
#include "inceres/factors/bal_reprojection.h"
#include "inceres/factors/body_reprojection.h"
#include "inceres/factors/diagonal_prior.h"
#include "inceres/factors/equidistant_reprojection.h"
#include "inceres/factors/planar_relative_pose.h"
#include "inceres/factors/point_reprojection.h"
#include "inceres/factors/pose_prior.h"
#include "inceres/factors/relative_pose.h"
#include "measurement_rows.h"
#include "module.h"

namespace inceres::python {
namespace {

template <typename Core>
struct Bound : FamilyOf<Core> {
  using FamilyOf<Core>::FamilyOf;
};
template <typename Core>
using Class = py::class_<Bound<Core>, Family, std::shared_ptr<Bound<Core>>>;

template <typename Core>
std::shared_ptr<Bound<Core>> Make(std::shared_ptr<Core> core, std::vector<int> columns,
                                  typename FamilyOf<Core>::Read read, int root_size = 0) {
  return std::make_shared<Bound<Core>>(std::move(core), std::move(columns), read, root_size);
}

LandmarkKind Landmark(bool homogeneous) {
  return homogeneous ? LandmarkKind::kHomogeneous : LandmarkKind::kPoint;
}
Perturbation Side(bool left) {
  return left ? Perturbation::kLeft : Perturbation::kRight;
}

// The numbers of a camera; those that are not given are 0.
std::vector<double> Intrinsics(const py::object& value, std::vector<py::ssize_t> sizes) {
  const auto array = DoubleArray::ensure(value);
  if (!array || array.ndim() != 1 ||
      std::find(sizes.begin(), sizes.end(), array.size()) == sizes.end()) {
    PyErr_Clear();
    std::string wanted;
    for (const py::ssize_t size : sizes) {
      wanted += (wanted.empty() ? "" : " or ") + std::to_string(size);
    }
    throw py::value_error("intrinsics: expected an array of " + wanted + " numbers");
  }
  std::vector<double> numbers(array.data(), array.data() + array.size());
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    if (!std::isfinite(numbers[i]) || (i < 2 && numbers[i] <= 0.0)) {
      throw py::value_error("intrinsics: entry " + std::to_string(i) + " is " +
                            std::to_string(numbers[i]));
    }
  }
  numbers.resize(8, 0.0);
  return numbers;
}

void BindBase(py::module_& module) {
  py::class_<Family, std::shared_ptr<Family>>(
      module, "Family",
      "Like factors: the same residual, measured anew by each. A family belongs to the graph or "
      "solver it was added to, and to no other.")
      .def_property_readonly("name", [](const Family& f) { return f.core()->Name(); })
      .def_property_readonly("residual_size",
                             [](const Family& f) { return f.core()->residual_size(); })
      .def_property_readonly(
          "slots",
          [](const Family& f) {
            py::list slots;
            for (int s = 0; s < f.core()->num_slots(); ++s) {
              slots.append(
                  py::make_tuple(f.core()->slot(s).ambient_size, f.core()->slot(s).tangent_size));
            }
            return slots;
          },
          "(ambient size, tangent size) of each variable a factor touches.")
      .def_property_readonly("columns", &Family::columns,
                             "How many numbers a row of measurements may have.")
      .def_property_readonly(
          "size", [](const Family& f) { return f.core()->size(); },
          "How many measurements it holds.");
}

// A landmark as pixels of a camera that has four intrinsics, and four of distortion or none.
template <typename CoreFamily, typename Camera>
void BindPixels(py::module_& module, const char* name, const char* what) {
  Class<CoreFamily>(module, name, what)
      .def(py::init([](const py::object& intrinsics, bool is_homogeneous, bool is_left) {
             const std::vector<double> c = Intrinsics(intrinsics, {4, 8});
             return Make(std::make_shared<CoreFamily>(
                             Camera{c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7]},
                             Landmark(is_homogeneous), Side(is_left)),
                         {2, 5}, &ReadPixel);
           }),
           py::arg("intrinsics"), py::arg("homogeneous") = false, py::arg("left") = false);
}

void BindLandmarkFamilies(py::module_& module) {
  const auto homogeneous = py::arg("homogeneous") = false;
  const auto left = py::arg("left") = false;
  BindPixels<PointReprojectionFamily, PinholeCamera>(
      module, "PointReprojection",
      "A landmark in a pinhole camera, intrinsics (f_x, f_y, c_x, c_y) or with Brown's distortion "
      "(…, k1, k2, p1, p2). Variables: body pose, camera on the body, landmark. Rows: u, v [, u00, "
      "u01, u11 of the square root information].");
  BindPixels<EquidistantReprojectionFamily, EquidistantCamera>(
      module, "EquidistantReprojection",
      "A landmark in a fisheye camera, intrinsics (f_x, f_y, c_x, c_y [, k1, k2, k3, k4]). "
      "Variables and rows as PointReprojection.");
  Class<StereoReprojectionFamily>(
      module, "StereoReprojection",
      "A landmark in a rectified stereo camera, intrinsics (f_x, f_y, c_x, c_y, baseline). "
      "Variables as PointReprojection. Rows: u_left, v, u_right [, 9 of the square root "
      "information, upper triangular, row by row].")
      .def(py::init([](const py::object& intrinsics, bool is_homogeneous, bool is_left) {
             const std::vector<double> c = Intrinsics(intrinsics, {5});
             return Make(std::make_shared<StereoReprojectionFamily>(
                             StereoCamera{c[0], c[1], c[2], c[3], c[4]}, Landmark(is_homogeneous),
                             Side(is_left)),
                         {3, 12}, &ReadStereo, /*root_size=*/3);
           }),
           py::arg("intrinsics"), homogeneous, left);
  Class<BearingFamily>(module, "Bearing",
                       "The direction of a landmark. Variables as PointReprojection. Rows: x, y, z "
                       "of the direction [, u00, u01, u11 of the square root information].")
      .def(py::init([](bool is_homogeneous, bool is_left) {
             return Make(std::make_shared<BearingFamily>(Landmark(is_homogeneous), Side(is_left)),
                         {3, 6}, &ReadBearing);
           }),
           homogeneous, left);
}

void BindPoseFamilies(py::module_& module) {
  Class<RelativePoseFamily>(
      module, "RelativePose",
      "A measured relative pose. Variables: poses a, b on PoseManifold. Residual: U [Log(R_a' R_b "
      "R_ab'); R_b' (p_a - p_b) - p_ab]. Rows: q_ab (x, y, z, w), p_ab, 36 of U, upper "
      "triangular, row by row.")
      .def(py::init([] {
        return Make(std::make_shared<RelativePoseFamily>(), {43}, &ReadRelativePose,
                    /*root_size=*/6);
      }));
  Class<PlanarRelativePoseFamily>(
      module, "PlanarRelativePose",
      "A measured relative pose of planar poses a, b, each (x, y, theta) without a manifold: U "
      "[R_a' (p_b - p_a) - p_m; wrap(theta_b - theta_a - theta_m)]. Rows: x, y, theta [, 9 of U, "
      "upper triangular, row by row].")
      .def(py::init([] {
        return Make(std::make_shared<PlanarRelativePoseFamily>(), {3, 12}, &ReadPlanar,
                    /*root_size=*/3);
      }));
  Class<PosePriorFamily>(module, "PosePrior",
                         "A prior on a pose. Rows: p (3), q (x, y, z, w), 36 of the square root "
                         "information, upper triangular, row by row.")
      .def(py::init([](bool left) {
             return Make(std::make_shared<PosePriorFamily>(Side(left)), {43}, &ReadPosePrior,
                         /*root_size=*/6);
           }),
           py::arg("left") = false);
  Class<SpeedBiasPriorFamily>(
      module, "SpeedBiasPrior",
      "A prior on nine Euclidean coordinates. Rows: their values, 81 of the square root "
      "information, upper triangular, row by row.")
      .def(py::init([] {
        return Make(std::make_shared<SpeedBiasPriorFamily>(), {90}, &ReadSpeedBiasPrior,
                    /*root_size=*/9);
      }));
  Class<DiagonalPriorFamily>(
      module, "DiagonalPrior",
      "A prior on the first `size` coordinates of a variable, each with its own standard "
      "deviation. Rows: size means, size times 1 / standard deviation.")
      .def(py::init([](int size, const py::object& ambient_size, const py::object& tangent_size) {
             const int ambient = ambient_size.is_none() ? size : ambient_size.cast<int>();
             const int tangent = tangent_size.is_none() ? ambient : tangent_size.cast<int>();
             if (size < 1 || size > ambient || tangent < 1 || tangent > ambient) {
               throw py::value_error(
                   "DiagonalPrior: expected 1 <= size <= ambient_size and 1 <= "
                   "tangent_size <= ambient_size");
             }
             return Make(std::make_shared<DiagonalPriorFamily>(size, ambient, tangent), {2 * size},
                         &ReadDiagonalPrior);
           }),
           py::arg("size"), py::arg("ambient_size") = py::none(),
           py::arg("tangent_size") = py::none());
}

void BindOtherReprojections(py::module_& module) {
  Class<BalReprojectionFamily>(
      module, "BalReprojection",
      "A point in a camera of the \"bundle adjustment in the large\" model. Variables: camera "
      "(rotation vector, t, f, k1, k2), point. Rows: x, y. Other tangent sizes are for cameras or "
      "points on a manifold.")
      .def(py::init([](int camera_tangent_size, int point_tangent_size) {
             if (camera_tangent_size < 1 || camera_tangent_size > 9 || point_tangent_size < 1 ||
                 point_tangent_size > 3) {
               throw py::value_error(
                   "BalReprojection: expected 1 <= camera_tangent_size <= 9 and "
                   "1 <= point_tangent_size <= 3");
             }
             using Bal = BalReprojectionFamily;
             return Make(std::make_shared<Bal>(camera_tangent_size, point_tangent_size), {2},
                         [](const double* row, int /*num_columns*/) {
                           return Bal::Measurement{row[0], row[1]};
                         });
           }),
           py::arg("camera_tangent_size") = 9, py::arg("point_tangent_size") = 3);
  Class<InverseDepthReprojectionFamily>(
      module, "InverseDepthReprojection",
      "A feature stored as bearing and inverse depth in its anchor. Variables: pose of the anchor, "
      "pose of the observer, inverse depth. Rows: x, y in the anchor, x, y in the observer, all in "
      "the plane z = 1 [, u00, u01, u11 of the square root information].")
      .def(py::init([] {
        return Make(std::make_shared<InverseDepthReprojectionFamily>(), {4, 7}, &ReadInverseDepth);
      }));
}

}  // namespace

void BindFamilies(py::module_& module) {
  BindBase(module);
  BindLandmarkFamilies(module);
  BindOtherReprojections(module);
  BindPoseFamilies(module);
  BindCustomFamily(module);
}

}  // namespace inceres::python
