#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "inceres/problem/factor_family.h"
#include "inceres/problem/graph_edit.h"

namespace inceres::python {

/// A family of factors as Python sees it: what it measures comes as rows of numbers.
class Family {
 public:
  /// `columns`: how many numbers a row may have, ascending. `root_size`: the longest rows end with
  /// all entries of a square root information U of so many rows and columns; 0: of none.
  Family(std::shared_ptr<const FactorFamily> core, std::vector<int> columns, int root_size = 0)
      : core_(std::move(core)), columns_(std::move(columns)), root_size_(root_size) {}
  virtual ~Family() = default;
  Family(const Family&) = delete;
  Family& operator=(const Family&) = delete;

  const std::shared_ptr<const FactorFamily>& core() const { return core_; }
  const std::vector<int>& columns() const { return columns_; }
  int root_size() const { return root_size_; }

  /// Overwrites the measurement at `index`, or appends it if index == size(); `row` has one of the
  /// numbers of columns.
  virtual void Place(int index, const double* row, int num_columns) = 0;
  /// The same when the edit is applied.
  virtual void SetMeasurement(FactorId id, const double* row, int num_columns, GraphEdit* edit) = 0;
  /// Which variables the factor at `index` touches.
  virtual void Connect(int /*index*/, const VariableId* /*variables*/) {}
  /// Raises, in Python, what a Python function of the family has raised since the last call.
  virtual void RaisePending() {}
  /// Whether there is something to raise.
  virtual bool HasPending() const { return false; }

  /// A family belongs to the graph or solver it was added to, and to no other.
  bool is_taken = false;

 private:
  std::shared_ptr<const FactorFamily> core_;
  std::vector<int> columns_;
  int root_size_;
};

/// Of a family of the core; `Read` makes its Measurement of a row.
template <typename Core>
class FamilyOf : public Family {
 public:
  using Measurement = typename Core::Measurement;
  using Read = Measurement (*)(const double* row, int num_columns);

  FamilyOf(std::shared_ptr<Core> core, std::vector<int> columns, Read read, int root_size = 0)
      : Family(core, std::move(columns), root_size), family_(std::move(core)), read_(read) {}

  void Place(int index, const double* row, int num_columns) override {
    family_->Place(index, read_(row, num_columns));
  }
  void SetMeasurement(FactorId id, const double* row, int num_columns, GraphEdit* edit) override {
    edit->SetMeasurement(id, FamilyHandle<Core>{id.family, family_}, read_(row, num_columns));
  }

 protected:
  Core* family() const { return family_.get(); }

 private:
  std::shared_ptr<Core> family_;
  Read read_;
};

}  // namespace inceres::python
