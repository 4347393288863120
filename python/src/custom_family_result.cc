// What a Python function returned: checked as it comes, handed over to the solver piece by piece.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>

#include "arrays.h"
#include "custom_family.h"
#include "inceres/problem/ambient_family.h"

namespace inceres::python {
namespace {

constexpr int kMaxStack = 512;  // doubles of a Jacobian that need no heap

double At(const char* address) {
  double value;
  std::memcpy(&value, address, sizeof(value));
  return value;
}

// An array of doubles, in the order in which the function's own lies in memory. A copy: the
// function may write to its arrays again when it is next called, be it for another family.
py::array CopyDoubles(const py::handle& returned, const std::string& what) {
  auto array = py::array_t<double, py::array::forcecast>::ensure(returned);
  if (!array) {
    PyErr_Clear();
    throw py::type_error(what + ": not an array of doubles");
  }
  return py::array(array.attr("copy")("K"));
}

std::string Shape(std::initializer_list<std::size_t> sizes) {
  std::string text;
  for (const std::size_t size : sizes) {
    text += (text.empty() ? "(" : ", ") + std::to_string(size);
  }
  return text + ")";
}

}  // namespace

void CustomFamily::TakeResiduals(const py::handle& returned, Result* result) const {
  const std::string what = name_ + ": residuals";
  const py::array array = CopyDoubles(returned, what);
  const auto count = static_cast<py::ssize_t>(result->factors.size());
  const bool flat = residual_size() == 1 && array.ndim() == 1;
  if (!(flat || (array.ndim() == 2 && array.shape(1) == residual_size())) ||
      array.shape(0) != count) {
    throw py::value_error(
        what + ": shape " + ShapeOf(array) + ", expected " +
        Shape({result->factors.size(), static_cast<std::size_t>(residual_size())}));
  }
  result->residuals = static_cast<const char*>(array.data());
  result->residual_strides[0] = array.strides(0);
  result->residual_strides[1] = flat ? 0 : array.strides(1);
  py::list owner;
  owner.append(array);
  result->owner = owner;
}

void CustomFamily::TakeJacobians(const py::handle& returned, const py::tuple& wanted,
                                 Result* result) const {
  if (!py::isinstance<py::sequence>(returned) ||
      py::len(returned) != static_cast<std::size_t>(num_slots())) {
    throw py::type_error(name_ + ": jacobians: expected a list of " + std::to_string(num_slots()) +
                         ", one a slot");
  }
  const auto sequence = py::reinterpret_borrow<py::sequence>(returned);
  result->jacobians.resize(static_cast<std::size_t>(num_slots()));
  for (int s = 0; s < num_slots(); ++s) {
    const auto at = static_cast<std::size_t>(s);
    if (!wanted[at].cast<bool>()) {
      continue;
    }
    const std::string what = name_ + ": jacobian of slot " + std::to_string(s);
    const py::array array = CopyDoubles(sequence[at], what);
    if (array.ndim() != 3 || array.shape(0) != static_cast<py::ssize_t>(result->factors.size()) ||
        array.shape(1) != residual_size() || array.shape(2) != slot(s).ambient_size) {
      throw py::value_error(
          what + ": shape " + ShapeOf(array) + ", expected " +
          Shape({result->factors.size(), static_cast<std::size_t>(residual_size()),
                 static_cast<std::size_t>(slot(s).ambient_size)}));
    }
    Result::Jacobian& J = result->jacobians[at];
    J.data = static_cast<const char*>(array.data());
    std::copy_n(array.strides(), 3, J.strides);
    result->owner.cast<py::list>().append(array);
  }
}

EvaluationFailure CustomFamily::HandOver(const FactorBatch& batch, const Result& result) const {
  const auto first = std::lower_bound(result.factors.begin(), result.factors.end(), batch.begin);
  std::ptrdiff_t k = first - result.factors.begin();
  int largest = 1;
  for (int s = 0; s < num_slots(); ++s) {
    largest = std::max(largest, residual_size() * slot(s).ambient_size);
  }
  double stack[kMaxStack];
  std::vector<double> heap(static_cast<std::size_t>(largest > kMaxStack ? largest : 0));
  double* const scratch = heap.empty() ? stack : heap.data();
  for (int i = batch.begin; i < batch.end; ++i, ++k) {
    double* f = batch.residuals + std::ptrdiff_t{i} * residual_size();
    const char* from = result.residuals + k * result.residual_strides[0];
    for (int r = 0; r < residual_size(); ++r, from += result.residual_strides[1]) {
      f[r] = At(from);
      if (!std::isfinite(f[r])) {
        return {i, "a residual is not finite", -1, r, f[r]};
      }
    }
    for (int s = 0; batch.jacobians != nullptr && s < num_slots(); ++s) {
      const Result::Jacobian& J = result.jacobians[static_cast<std::size_t>(s)];
      const EvaluationFailure failure =
          HandOverJacobian(batch, i, s, J.data + k * J.strides[0], J, scratch);
      if (failure.failed()) {
        return failure;
      }
    }
  }
  return {};
}

EvaluationFailure CustomFamily::HandOverJacobian(const FactorBatch& batch, int i, int slot,
                                                 const char* from, const Result::Jacobian& J,
                                                 double* scratch) const {
  const TangentMap& map = *batch.tangent_maps[std::ptrdiff_t{i} * num_slots() + slot];
  if (!map.wanted()) {
    return {};
  }
  const JacobianView& view = batch.jacobians[slot];
  double* const to = view.data + i * view.factor_stride;
  const int columns = this->slot(slot).ambient_size;
  const bool in_place = map.kind == TangentMap::Kind::kIdentity;
  const int row_stride = in_place ? view.row_stride : columns;
  double* const rows = in_place ? to : scratch;
  double sum = 0.0;
  for (int r = 0; r < residual_size(); ++r) {
    const char* entry = from + r * J.strides[1];
    for (int c = 0; c < columns; ++c, entry += J.strides[2]) {
      const double value = At(entry);
      rows[r * row_stride + c] = value;
      sum += 0.0 * value;
    }
  }
  for (int e = 0; !(sum == 0.0) && e < residual_size() * columns; ++e) {
    const double value = rows[e / columns * row_stride + e % columns];
    if (!std::isfinite(value)) {
      return {i, "a Jacobian entry is not finite", slot, e, value};
    }
  }
  if (!in_place) {
    ProjectToTangentSpace(map, scratch, residual_size(), to, view.row_stride);
  }
  return {};
}

}  // namespace inceres::python
