#include "custom_family.h"

#include <algorithm>
#include <unordered_map>
#include <utility>

namespace inceres::python {
namespace {

using Columns = py::array_t<double, py::array::f_style>;

// (rows, columns), each column contiguous: NumPy is fast on columns.
Columns MakeColumns(std::size_t rows, int columns) {
  return Columns({static_cast<py::ssize_t>(rows), static_cast<py::ssize_t>(columns)});
}

void MakeReadOnly(const py::array& array) {
  py::detail::array_proxy(array.ptr())->flags &= ~py::detail::npy_api::NPY_ARRAY_WRITEABLE_;
}

}  // namespace

CustomFamily::CustomFamily(int residual_size, std::vector<Slot> slots, int measurement_size,
                           bool shared, std::string name, py::function evaluate)
    : FactorFamily(residual_size, std::move(slots)),
      measurement_size_(measurement_size),
      shared_(shared),
      name_(std::move(name)),
      evaluate_(std::move(evaluate)) {
}

CustomFamily::~CustomFamily() {
  const py::gil_scoped_acquire gil;
  prepared_ = Result();
  kept_measurements_ = py::array();
  kept_indices_.clear();
  pending_ = nullptr;
  evaluate_ = py::function();
}

void CustomFamily::Place(int index, const Measurement& measurement) {
  const auto first = static_cast<std::size_t>(index) * static_cast<std::size_t>(measurement_size_);
  if (index == size_) {
    ++size_;
    measurements_.resize(first + measurement.size());
  }
  std::copy(measurement.begin(), measurement.end(),
            measurements_.begin() + static_cast<std::ptrdiff_t>(first));
  ++version_;
}

void CustomFamily::Connect(int index, const VariableId* variables) {
  const auto first = static_cast<std::size_t>(index) * static_cast<std::size_t>(num_slots());
  const auto end = first + static_cast<std::size_t>(num_slots());
  variables_.resize(std::max(variables_.size(), end));
  std::copy_n(variables, num_slots(), variables_.begin() + static_cast<std::ptrdiff_t>(first));
  ++version_;
}

void CustomFamily::RaisePending() {
  has_pending_ = false;
  if (std::exception_ptr pending = std::exchange(pending_, nullptr)) {
    std::rethrow_exception(pending);
  }
}

EvaluationFailure CustomFamily::Prepare(const FactorBatch& batch, const std::int32_t* factors,
                                        int count) const {
  return Call(batch, factors, count, &prepared_);
}

EvaluationFailure CustomFamily::Evaluate(const FactorBatch& batch) const {
  if (batch.prepared) {
    return HandOver(batch, prepared_);
  }
  std::vector<std::int32_t> factors;
  for (int i = batch.begin; i < batch.end; ++i) {
    factors.push_back(i);
  }
  // Until the result is gone, which owns arrays of Python.
  const py::gil_scoped_acquire gil;
  Result result;
  const EvaluationFailure failure =
      Call(batch, factors.data(), static_cast<int>(factors.size()), &result);
  return failure.failed() ? failure : HandOver(batch, result);
}

EvaluationFailure CustomFamily::Call(const FactorBatch& batch, const std::int32_t* factors,
                                     int count, Result* result) const {
  const py::gil_scoped_acquire gil;
  *result = Result();
  if (has_pending_) {
    return {factors[0], "its Python function has raised an exception before"};
  }
  result->factors.assign(factors, factors + count);
  try {
    CallFunction(batch, result);
  } catch (...) {
    pending_ = std::current_exception();
    has_pending_ = true;
    return {factors[0], "its Python function raised an exception"};
  }
  return {};
}

void CustomFamily::CallFunction(const FactorBatch& batch, Result* result) const {
  const py::array measurements = Measurements(result->factors);
  py::list parameters;
  for (int s = 0; s < num_slots(); ++s) {
    parameters.append(Parameters(batch, s, *result));
  }
  const py::tuple wanted = Wanted(batch, *result);
  const py::object returned = evaluate_(measurements, parameters, wanted);
  if (wanted.empty()) {
    TakeResiduals(returned, result);
    return;
  }
  if (!py::isinstance<py::tuple>(returned) || py::len(returned) != 2) {
    throw py::type_error(name_ +
                         ": with Jacobians wanted the function returns a tuple "
                         "(residuals, jacobians)");
  }
  TakeResiduals(returned.cast<py::tuple>()[0], result);
  TakeJacobians(returned.cast<py::tuple>()[1], wanted, result);
}

// Kept while the same factors are asked for, as in a batch solve.
py::array CustomFamily::Measurements(const std::vector<std::int32_t>& factors) const {
  if (kept_version_ == version_ && kept_factors_ == factors) {
    return kept_measurements_;
  }
  Columns columns = MakeColumns(factors.size(), measurement_size_);
  double* to = columns.mutable_data();
  for (int c = 0; c < measurement_size_; ++c) {
    for (const std::int32_t factor : factors) {
      *to++ = measurements_[static_cast<std::size_t>(factor) *
                                static_cast<std::size_t>(measurement_size_) +
                            static_cast<std::size_t>(c)];
    }
  }
  MakeReadOnly(columns);
  kept_version_ = version_;
  kept_factors_ = factors;
  kept_measurements_ = columns;
  kept_indices_.clear();
  kept_first_.clear();
  return kept_measurements_;
}

py::object CustomFamily::Parameters(const FactorBatch& batch, int slot,
                                    const Result& result) const {
  if (shared_) {
    return SharedParameters(batch, slot, result);
  }
  const int size = this->slot(slot).ambient_size;
  const std::size_t count = result.factors.size();
  Columns columns = MakeColumns(count, size);
  double* to = columns.mutable_data();
  for (std::size_t k = 0; k < count; ++k, ++to) {
    const double* x = batch.parameters[std::ptrdiff_t{result.factors[k]} * num_slots() + slot];
    for (int c = 0; c < size; ++c) {
      to[static_cast<std::size_t>(c) * count] = x[c];
    }
  }
  return std::move(columns);
}

// Which variables there are is kept as the measurements are, with which this is called.
py::object CustomFamily::SharedParameters(const FactorBatch& batch, int slot,
                                          const Result& result) const {
  if (static_cast<int>(kept_indices_.size()) == slot) {
    std::unordered_map<VariableId, std::int64_t> numbers;
    std::vector<std::int32_t> first;
    py::array_t<std::int64_t> index(static_cast<py::ssize_t>(result.factors.size()));
    std::int64_t* to = index.mutable_data();
    for (const std::int32_t factor : result.factors) {
      const VariableId id =
          variables_[static_cast<std::size_t>(std::ptrdiff_t{factor} * num_slots() + slot)];
      const auto [found, added] = numbers.try_emplace(id, static_cast<std::int64_t>(first.size()));
      if (added) {
        first.push_back(factor);
      }
      *to++ = found->second;
    }
    MakeReadOnly(index);
    kept_indices_.push_back(index);
    kept_first_.push_back(std::move(first));
  }
  const std::vector<std::int32_t>& first = kept_first_[static_cast<std::size_t>(slot)];
  const int size = this->slot(slot).ambient_size;
  Columns values = MakeColumns(first.size(), size);
  double* to = values.mutable_data();
  for (std::size_t v = 0; v < first.size(); ++v, ++to) {
    const double* x = batch.parameters[std::ptrdiff_t{first[v]} * num_slots() + slot];
    for (int c = 0; c < size; ++c) {
      to[static_cast<std::size_t>(c) * first.size()] = x[c];
    }
  }
  return py::make_tuple(values, kept_indices_[static_cast<std::size_t>(slot)]);
}

py::tuple CustomFamily::Wanted(const FactorBatch& batch, const Result& result) const {
  if (batch.jacobians == nullptr) {
    return py::tuple();
  }
  py::tuple wanted(num_slots());
  for (int s = 0; s < num_slots(); ++s) {
    wanted[static_cast<std::size_t>(s)] =
        std::any_of(result.factors.begin(), result.factors.end(), [&](std::int32_t factor) {
          return batch.tangent_maps[std::ptrdiff_t{factor} * num_slots() + s]->wanted();
        });
  }
  return wanted;
}

}  // namespace inceres::python
