#pragma once

#include <map>
#include <memory>
#include <vector>

#include <Eigen/Core>

#include "inceres/problem/graph_edit.h"
#include "inceres/solver/marginalization.h"
#include "support/test_families.h"

namespace inceres::test {

/// One linear factor: f(x) = A x − b over the entries of its variables.
struct LinearMeasurement {
  Eigen::MatrixXd A;
  Eigen::VectorXd b;
};

/// Linear factors of one shape.
class LinearFamily final : public MeasuredFamily<LinearMeasurement, AmbientFamily<LinearFamily>> {
 public:
  using MeasuredFamily::MeasuredFamily;

  const char* Name() const override { return "linear"; }
  bool EvaluateOne(int i, const double* const* parameters, double* residuals,
                   double** jacobians) const {
    const Measurement& measurement = this->measurement(i);
    Eigen::Map<Eigen::VectorXd> f(residuals, residual_size());
    f = -measurement.b;
    int column = 0;
    for (int s = 0; s < num_slots(); ++s) {
      const int size = slot(s).ambient_size;
      f += measurement.A.middleCols(column, size) *
           Eigen::Map<const Eigen::VectorXd>(parameters[s], size);
      if (jacobians != nullptr && jacobians[s] != nullptr) {
        using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
        Eigen::Map<RowMajor>(jacobians[s], residual_size(), size) =
            measurement.A.middleCols(column, size);
      }
      column += size;
    }
    return true;
  }
};

/// The families of linear factors of one graph, by shape. `add_family` puts a new one into the
/// graph.
class LinearFamilies {
 public:
  template <typename AddFamily>
  FamilyHandle<LinearFamily> For(int rows, const std::vector<int>& sizes,
                                 const AddFamily& add_family) {
    std::vector<int> key = sizes;
    key.push_back(rows);
    FamilyHandle<LinearFamily>& handle = families_[key];
    if (handle.family == nullptr) {
      std::vector<FactorFamily::Slot> slots;
      for (const int size : sizes) {
        slots.push_back({size, size});
      }
      handle = add_family(std::make_shared<LinearFamily>(rows, slots));
    }
    return handle;
  }

 private:
  std::map<std::vector<int>, FamilyHandle<LinearFamily>> families_;
};

/// A graph of linear factors, changed by edits.
struct LinearWorld {
  VariableId AddVariable(const Eigen::VectorXd& x, Role role = Role::kFrame) {
    GraphEdit edit(graph);
    const VariableId id = edit.AddVariable(x.data(), static_cast<int>(x.size()), role);
    EXPECT_TRUE(graph.Apply(edit).ok());
    return id;
  }
  FactorId AddFactor(const std::vector<VariableId>& ids, const Eigen::MatrixXd& A,
                     const Eigen::VectorXd& b) {
    std::vector<int> sizes;
    for (const VariableId id : ids) {
      sizes.push_back(graph.AmbientSize(id));
    }
    const auto family = families.For(static_cast<int>(b.size()), sizes,
                                     [&](const auto& added) { return graph.AddFamily(added); });
    GraphEdit edit(graph);
    const FactorId factor = edit.AddFactor(family, {A, b}, ids);
    const Status status = graph.Apply(edit);
    EXPECT_TRUE(status.ok()) << status.message;
    return factor;
  }

  FactorGraph graph;
  LinearFamilies families;
};

inline Eigen::MatrixXd RandomMatrix(Random* random, Eigen::Index rows, Eigen::Index cols) {
  Eigen::MatrixXd A(rows, cols);
  for (Eigen::Index r = 0; r < rows; ++r) {
    for (Eigen::Index c = 0; c < cols; ++c) {
      A(r, c) = random->Unit();
    }
  }
  return A;
}

inline Eigen::MatrixXd InformationOf(const LinearPrior& prior) {
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const Eigen::Map<const RowMajor> J(prior.J.data(), static_cast<Eigen::Index>(prior.e0.size()),
                                     prior.num_columns());
  return J.transpose() * J;
}

inline Eigen::VectorXd GradientOf(const LinearPrior& prior) {
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const auto rows = static_cast<Eigen::Index>(prior.e0.size());
  const Eigen::Map<const RowMajor> J(prior.J.data(), rows, prior.num_columns());
  return J.transpose() * Eigen::Map<const Eigen::VectorXd>(prior.e0.data(), rows);
}

}  // namespace inceres::test
