#include <memory>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include <pybind11/stl.h>

#include "arrays.h"
#include "custom_family.h"
#include "module.h"

namespace inceres::python {
namespace {

class BoundCustomFamily final : public FamilyOf<CustomFamily> {
 public:
  explicit BoundCustomFamily(std::shared_ptr<CustomFamily> core)
      : FamilyOf(core, {core->measurement_size()}, [](const double* row, int num_columns) {
          return std::vector<double>(row, row + num_columns);
        }) {}

  void Connect(int index, const VariableId* variables) override {
    family()->Connect(index, variables);
  }
  void RaisePending() override { family()->RaisePending(); }
  bool HasPending() const override { return family()->HasPending(); }
};

constexpr int kMaxSize = 100'000;

std::shared_ptr<BoundCustomFamily> Make(int residual_size, const py::sequence& sizes,
                                        int measurement_size, py::function evaluate, bool shared,
                                        const std::string& name) {
  const auto check = [](int size, int least, const char* what) {
    if (size < least || size > kMaxSize) {
      throw py::value_error(std::string(what) + ": " + std::to_string(size) + ", not in [" +
                            std::to_string(least) + ", " + std::to_string(kMaxSize) + "]");
    }
  };
  check(residual_size, 1, "residual_size");
  check(measurement_size, 0, "measurement_size");
  check(static_cast<int>(py::len(sizes)), 1, "slots, how many");
  std::vector<FactorFamily::Slot> slots;
  for (const py::handle& entry : sizes) {
    FactorFamily::Slot slot;
    if (py::isinstance<py::int_>(entry)) {
      slot.ambient_size = slot.tangent_size = entry.cast<int>();
    } else {
      std::tie(slot.ambient_size, slot.tangent_size) = entry.cast<std::pair<int, int>>();
    }
    check(slot.ambient_size, 1, "slots, an ambient size");
    check(slot.tangent_size, 1, "slots, a tangent size");
    slots.push_back(slot);
  }
  return std::make_shared<BoundCustomFamily>(std::make_shared<CustomFamily>(
      residual_size, std::move(slots), measurement_size, shared, name, std::move(evaluate)));
}

}  // namespace

void BindCustomFamily(py::module_& module) {
  py::class_<BoundCustomFamily, Family, std::shared_ptr<BoundCustomFamily>>(
      module, "CustomFamily",
      "Factors whose residuals and Jacobians a Python function computes, all of an evaluation in "
      "one call:\n\n"
      "    evaluate(measurements, parameters, wanted) -> residuals or (residuals, jacobians)\n\n"
      "measurements: (k, measurement_size). parameters: one array (k, ambient size) a slot; if "
      "shared, a pair (values (v, ambient size), index (k,)) a slot, of the distinct variables and "
      "which of them each factor touches. Columns are contiguous. wanted: a tuple of bools, a slot "
      "each, empty if residuals alone are wanted. Residuals are (k, residual_size), Jacobians (k, "
      "residual_size, ambient size) a slot, with any strides, in ambient coordinates: manifolds "
      "are applied to them; None will do where not wanted. What is returned is copied: the next "
      "call may use the arrays again.")
      .def(py::init(&Make), py::arg("residual_size"), py::arg("slots"), py::arg("measurement_size"),
           py::arg("evaluate"), py::kw_only(), py::arg("shared") = false,
           py::arg("name") = "custom");
}

}  // namespace inceres::python
