#pragma once

#include <atomic>
#include <exception>
#include <string>
#include <vector>

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include "family.h"

namespace inceres::python {

namespace py = pybind11;

/// Factors whose residuals and Jacobians a Python function computes, all of an evaluation in one
/// call:
///
///     evaluate(measurements, parameters, wanted) -> residuals, or (residuals, jacobians)
///
/// measurements (k, m); parameters one array (k, ambient size) a slot, or, `shared`, one pair
/// (values (v, ambient size), index (k,)) a slot of the distinct variables and which of them each
/// factor touches; wanted: a tuple of bools, a slot each, empty if residuals alone are. Residuals
/// are (k, residual size), Jacobians (k, residual size, ambient size) a slot, or None where not
/// wanted.
///
/// The solving thread announces what is to be evaluated (Prepare) and takes the GIL for that call;
/// the threads that then fetch their ranges only copy and project, without it. What the function
/// returns is copied at once. What it raises is kept for RaisePending, and from then on every
/// evaluation fails.
class CustomFamily final : public FactorFamily {
 public:
  using Measurement = std::vector<double>;

  CustomFamily(int residual_size, std::vector<Slot> slots, int measurement_size, bool shared,
               std::string name, py::function evaluate);
  ~CustomFamily() override;

  void Place(int index, const Measurement& measurement);
  void Connect(int index, const VariableId* variables);
  int measurement_size() const { return measurement_size_; }

  void RaisePending();
  bool HasPending() const { return has_pending_; }

  int size() const override { return size_; }
  const char* Name() const override { return name_.c_str(); }
  bool Prepares() const override { return true; }
  EvaluationFailure Prepare(const FactorBatch& batch, const std::int32_t* factors,
                            int count) const override;
  EvaluationFailure Evaluate(const FactorBatch& batch) const override;

 private:
  // What the function has returned, and of which factors.
  struct Result {
    std::vector<std::int32_t> factors;  // ascending
    py::object owner;                   // holds the arrays, which are copies
    const char* residuals = nullptr;
    std::ptrdiff_t residual_strides[2] = {0, 0};  // bytes: factor, row
    struct Jacobian {
      const char* data = nullptr;  // null: not wanted
      std::ptrdiff_t strides[3] = {0, 0, 0};
    };
    std::vector<Jacobian> jacobians;  // empty: residuals alone
  };

  EvaluationFailure Call(const FactorBatch& batch, const std::int32_t* factors, int count,
                         Result* result) const;
  void CallFunction(const FactorBatch& batch, Result* result) const;
  py::array Measurements(const std::vector<std::int32_t>& factors) const;
  py::object Parameters(const FactorBatch& batch, int slot, const Result& result) const;
  py::object SharedParameters(const FactorBatch& batch, int slot, const Result& result) const;
  py::tuple Wanted(const FactorBatch& batch, const Result& result) const;
  void TakeResiduals(const py::handle& returned, Result* result) const;
  void TakeJacobians(const py::handle& returned, const py::tuple& wanted, Result* result) const;
  EvaluationFailure HandOver(const FactorBatch& batch, const Result& result) const;
  EvaluationFailure HandOverJacobian(const FactorBatch& batch, int i, int slot, const char* from,
                                     const Result::Jacobian& J, double* scratch) const;

  int measurement_size_;
  bool shared_;
  std::string name_;
  int size_ = 0;
  std::vector<double> measurements_;   // factor-major
  std::vector<VariableId> variables_;  // factor-major, num_slots each
  std::int64_t version_ = 0;           // grows with what Place and Connect change
  py::function evaluate_;

  mutable Result prepared_;
  // Of the last whole evaluation, kept while nothing changes: columns of measurements, and of
  // shared variables which factor touches which.
  mutable std::int64_t kept_version_ = -1;
  mutable std::vector<std::int32_t> kept_factors_;
  mutable py::array kept_measurements_;
  mutable std::vector<py::array> kept_indices_;
  mutable std::vector<std::vector<std::int32_t>> kept_first_;  // a factor of each distinct variable
  mutable std::atomic<bool> has_pending_{false};
  mutable std::exception_ptr pending_;
};

}  // namespace inceres::python
