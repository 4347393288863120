#include "inceres/problem/losses.h"

#include <cmath>
#include <memory>
#include <string>
#include <utility>

#include "arrays.h"
#include "module.h"

namespace inceres::python {
namespace {

template <typename T>
using Class = py::class_<T, Loss, std::shared_ptr<T>>;

double Positive(double value, const char* name) {
  if (!(value > 0.0) || std::isinf(value)) {
    throw py::value_error(std::string(name) + ": " + std::to_string(value) +
                          ", expected a positive number");
  }
  return value;
}

template <typename T>
void BindScaled(py::module_& module, const char* name, const char* text) {
  Class<T>(module, name, text)
      .def(py::init([](double a) { return std::make_shared<T>(Positive(a, "a")); }), py::arg("a"));
}

py::tuple Evaluate(const Loss& loss, double s) {
  if (!(s >= 0.0)) {
    throw py::value_error("s: " + std::to_string(s) + ", expected a squared norm, at least 0");
  }
  double rho[3];
  loss.Evaluate(s, rho);
  return py::make_tuple(rho[0], rho[1], rho[2]);
}

}  // namespace

void BindLosses(py::module_& module) {
  py::class_<Loss, std::shared_ptr<Loss>>(
      module, "Loss",
      "A robust loss rho(s) of the squared norm s of a factor's whitened residual; the cost is "
      "half "
      "the sum of rho. Immutable: share one among factors, graphs and threads.")
      .def("evaluate", &Evaluate, py::arg("s"), "(rho(s), rho'(s), rho''(s)).");
  BindScaled<HuberLoss>(module, "HuberLoss",
                        "Quadratic up to a residual norm of a, linear in the norm beyond.");
  BindScaled<SoftLOneLoss>(module, "SoftLOneLoss",
                           "2 a^2 (sqrt(1 + s / a^2) - 1): a smooth HuberLoss.");
  BindScaled<CauchyLoss>(module, "CauchyLoss", "a^2 log(1 + s / a^2).");
  BindScaled<ArctanLoss>(module, "ArctanLoss",
                         "a atan(s / a); here a is in units of the squared norm.");
  BindScaled<TukeyLoss>(module, "TukeyLoss",
                        "Tukey's biweight: residuals beyond a norm of a have no influence.");
  Class<TolerantLoss>(module, "TolerantLoss",
                      "Nearly nothing up to s = a, then s - a; b is the width of the transition.")
      .def(py::init([](double a, double b) {
             return std::make_shared<TolerantLoss>(Positive(a, "a"), Positive(b, "b"));
           }),
           py::arg("a"), py::arg("b"));
  Class<ScaledLoss>(module, "ScaledLoss", "scale * rho(s); without a loss, scale * s.")
      .def(py::init([](std::shared_ptr<Loss> loss, double scale) {
             return std::make_shared<ScaledLoss>(std::move(loss), Positive(scale, "scale"));
           }),
           py::arg("loss").none(true), py::arg("scale"));
  Class<ComposedLoss>(module, "ComposedLoss", "f(g(s)); None means the identity.")
      .def(py::init([](std::shared_ptr<Loss> f, std::shared_ptr<Loss> g) {
             return std::make_shared<ComposedLoss>(std::move(f), std::move(g));
           }),
           py::arg("f").none(true), py::arg("g").none(true));
}

}  // namespace inceres::python
