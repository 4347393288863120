#include "inceres/problem/manifolds.h"

#include <algorithm>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <pybind11/stl.h>

#include "arrays.h"
#include "module.h"

namespace inceres::python {
namespace {

template <typename T>
using Class = py::class_<T, Manifold, std::shared_ptr<T>>;

int Positive(int size, int least) {
  if (size < least) {
    throw py::value_error("size: " + std::to_string(size) + ", expected at least " +
                          std::to_string(least));
  }
  return size;
}

// op(x row, other row, result row) for each row; false: undefined there.
template <typename Operation>
py::array Rowwise(const py::object& a, const char* a_name, int a_size, const py::object& b,
                  const char* b_name, int b_size, int result_size, const Operation& operation) {
  const DoubleArray x = ToMatrix(a, a_name, a_size), y = ToMatrix(b, b_name, b_size);
  if (x.shape(0) != y.shape(0)) {
    throw py::value_error(std::string(b_name) + ": " + std::to_string(y.shape(0)) + " rows, " +
                          a_name + " has " + std::to_string(x.shape(0)));
  }
  py::array_t<double> result({x.shape(0), static_cast<py::ssize_t>(result_size)});
  for (py::ssize_t i = 0; i < x.shape(0); ++i) {
    if (!operation(x.data() + i * a_size, y.data() + i * b_size,
                   result.mutable_data() + i * result_size)) {
      throw py::value_error(std::string(a_name) + ": row " + std::to_string(i) +
                            ": the operation is undefined there");
    }
  }
  return std::move(result);
}

py::array Plus(const Manifold& manifold, const py::object& x, const py::object& delta) {
  const int a = manifold.AmbientSize(), d = manifold.TangentSize();
  return Rowwise(x, "x", a, delta, "delta", d, a,
                 [&](const double* from, const double* step, double* to) {
                   return manifold.Plus(from, step, to);
                 });
}

py::array Minus(const Manifold& manifold, const py::object& y, const py::object& x) {
  const int a = manifold.AmbientSize(), d = manifold.TangentSize();
  return Rowwise(y, "y", a, x, "x", a, d, [&](const double* to, const double* from, double* step) {
    return manifold.Minus(to, from, step);
  });
}

template <typename T>
void BindPlain(py::module_& module, const char* name, const char* text) {
  Class<T>(module, name, text).def(py::init<>());
}

}  // namespace

void BindManifolds(py::module_& module) {
  py::class_<Manifold, std::shared_ptr<Manifold>>(
      module, "Manifold",
      "The space a variable lives on. Immutable: share one among variables and graphs.")
      .def_property_readonly("ambient_size", &Manifold::AmbientSize,
                             "How many numbers store a point.")
      .def_property_readonly("tangent_size", &Manifold::TangentSize, "Its degrees of freedom.")
      .def("plus", &Plus, py::arg("x"), py::arg("delta"),
           "Moves points (n, ambient_size) along tangent vectors (n, tangent_size).")
      .def("minus", &Minus, py::arg("y"), py::arg("x"),
           "The tangent vectors (n, tangent_size) that lead from x to y, each (n, ambient_size).");
  Class<EuclideanManifold>(module, "EuclideanManifold", "R^n, for ProductManifold.")
      .def(
          py::init([](int size) { return std::make_shared<EuclideanManifold>(Positive(size, 1)); }),
          py::arg("size"));
  Class<SubsetManifold>(module, "SubsetManifold", "R^n with some coordinates held constant.")
      .def(py::init([](int size, const std::vector<int>& constant) {
             for (const int index : constant) {
               if (index < 0 || index >= Positive(size, 1)) {
                 throw py::value_error("constant: " + std::to_string(index) + ", not in [0, " +
                                       std::to_string(size) + ")");
               }
             }
             return std::make_shared<SubsetManifold>(Positive(size, 1), constant);
           }),
           py::arg("size"), py::arg("constant"));
  Class<ProductManifold>(module, "ProductManifold", "Several manifolds side by side.")
      .def(py::init([](const std::vector<std::shared_ptr<Manifold>>& components) {
             if (std::find(components.begin(), components.end(), nullptr) != components.end()) {
               throw py::type_error("components: None is no Manifold");
             }
             return std::make_shared<ProductManifold>(std::vector<std::shared_ptr<const Manifold>>(
                 components.begin(), components.end()));
           }),
           py::arg("components"));
  Class<SphereManifold>(module, "SphereManifold",
                        "The sphere of radius |x| in R^n: homogeneous points, directions.")
      .def(py::init([](int size) { return std::make_shared<SphereManifold>(Positive(size, 2)); }),
           py::arg("size"));
  BindPlain<QuaternionManifold>(module, "QuaternionManifold",
                                "Rotation w, x, y, z, as Ceres's QuaternionManifold.");
  BindPlain<EigenQuaternionManifold>(module, "EigenQuaternionManifold",
                                     "Rotation x, y, z, w, as Ceres's EigenQuaternionManifold.");
  BindPlain<RotationQuaternionManifold>(module, "RotationQuaternionManifold",
                                        "Rotation x, y, z, w, turned on the right: R Exp(phi).");
  BindPlain<PoseManifold>(module, "PoseManifold",
                          "Pose p (3), q (x, y, z, w): p + dp, R Exp(phi). Of all built-in factors "
                          "on poses unless they say otherwise.");
  BindPlain<LeftPoseManifold>(module, "LeftPoseManifold",
                              "Pose p (3), q (x, y, z, w): p + dp, Exp(phi) R.");
  BindPlain<SE3Manifold>(module, "SE3Manifold", "Pose p (3), q (x, y, z, w): T Exp(rho, phi).");
  BindPlain<SimilarityManifold>(module, "SimilarityManifold",
                                "Pose with a scale p (3), q (x, y, z, w), s: p + dp, R Exp(phi), "
                                "s exp(sigma).");
  BindPlain<SE2Manifold>(module, "SE2Manifold", "Planar pose x, y, theta: T Exp(rho, omega).");
}

}  // namespace inceres::python
