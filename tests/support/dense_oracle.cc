#include "support/dense_oracle.h"

#include <cmath>

#include <gtest/gtest.h>

namespace inceres::test {
namespace {

using RowMajorMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// Column of each variable, or -1.
std::vector<int> ColumnsOf(const FactorGraph& graph, const std::vector<VariableId>& variables,
                           int* num_columns) {
  std::vector<int> column(static_cast<std::size_t>(graph.num_variables()), -1);
  *num_columns = 0;
  for (const VariableId id : variables) {
    column[static_cast<std::size_t>(id)] = *num_columns;
    *num_columns += graph.TangentSize(id);
  }
  return column;
}

// One tangent map per variable: constant, or dense even where it is the identity.
struct Maps {
  Maps(const FactorGraph& graph, const std::vector<int>& column) {
    for (VariableId id = 0; id < graph.num_variables(); ++id) {
      RowMajorMatrix& M =
          plus.emplace_back(RowMajorMatrix::Identity(graph.AmbientSize(id), graph.TangentSize(id)));
      const bool constant = column[static_cast<std::size_t>(id)] < 0;
      if (!constant && graph.manifold(id) != nullptr) {
        EXPECT_TRUE(graph.manifold(id)->PlusJacobian(graph.Values(id), M.data()));
      }
      TangentMap& map = maps.emplace_back();
      map.kind = constant ? TangentMap::Kind::kConstant : TangentMap::Kind::kDense;
      map.ambient_size = graph.AmbientSize(id);
      map.tangent_size = graph.TangentSize(id);
    }
    for (std::size_t i = 0; i < maps.size(); ++i) {
      maps[i].plus_jacobian = plus[i].data();
    }
  }
  std::vector<RowMajorMatrix> plus;
  std::vector<TangentMap> maps;
};

// f := scale f, J := √ρ' (I − α/s f fᵀ) J, where α is the root below 1 of ½α² − α − s ρ''/ρ' = 0,
// or 0 where ρ'' ≤ 0.
double Correct(const Loss* loss, Eigen::Ref<Eigen::VectorXd> f, Eigen::Ref<Eigen::MatrixXd> J) {
  const double s = f.squaredNorm();
  if (loss == nullptr) {
    return 0.5 * s;
  }
  double rho[3];
  loss->Evaluate(s, rho);
  const double alpha =
      rho[2] > 0.0 && s > 0.0 ? 1.0 - std::sqrt(1.0 + 2.0 * s * rho[2] / rho[1]) : 0.0;
  if (alpha != 0.0) {
    const Eigen::MatrixXd projector =
        Eigen::MatrixXd::Identity(f.size(), f.size()) - alpha / s * f * f.transpose();
    J = (projector * J).eval();
  }
  J *= std::sqrt(rho[1]);
  f *= std::sqrt(rho[1]) / (1.0 - alpha);
  return 0.5 * rho[0];
}

struct FamilyRows {
  std::vector<double> residuals;
  std::vector<std::vector<double>> jacobians;  // per slot, unpadded
};

FamilyRows EvaluateFamily(const FactorGraph& graph, FamilyId id, const std::vector<double>& state,
                          const Maps* maps) {
  const FactorFamily& family = graph.family(id);
  const auto n = static_cast<std::size_t>(graph.NumFactors(id));
  FamilyRows rows;
  rows.residuals.resize(n * static_cast<std::size_t>(family.residual_size()));
  std::vector<const double*> parameters;
  std::vector<const TangentMap*> map_of;
  for (int i = 0; i < graph.NumFactors(id); ++i) {
    for (int s = 0; s < family.num_slots(); ++s) {
      const VariableId variable = graph.Variables(id, i)[s];
      const bool gap = variable < 0;  // the rows of a free place stay zero
      parameters.push_back(gap ? nullptr : graph.ValuesIn(state.data(), variable));
      map_of.push_back(maps == nullptr || gap ? nullptr
                                              : &maps->maps[static_cast<std::size_t>(variable)]);
    }
  }
  std::vector<JacobianView> views;
  for (int s = 0; s < family.num_slots(); ++s) {
    const int size = family.slot(s).tangent_size;
    const std::ptrdiff_t stride = static_cast<std::ptrdiff_t>(family.residual_size()) * size;
    rows.jacobians.emplace_back(n * static_cast<std::size_t>(stride));
    views.push_back({rows.jacobians.back().data(), stride, size});
  }
  FactorBatch batch;
  batch.parameters = parameters.data();
  batch.residuals = rows.residuals.data();
  if (maps != nullptr) {
    batch.tangent_maps = map_of.data();
    batch.jacobians = views.data();
  }
  for (batch.begin = 0; batch.begin < graph.NumFactors(id); batch.begin = batch.end) {
    // Up to the next free place, or over one.
    batch.end = batch.begin + 1;
    if (!graph.HasFactor(id, batch.begin)) {
      continue;
    }
    while (graph.HasFactor(id, batch.end)) {
      ++batch.end;
    }
    const EvaluationFailure failure = family.Evaluate(batch);
    EXPECT_FALSE(failure.failed()) << failure.reason;
  }
  return rows;
}

}  // namespace

std::vector<VariableId> MovingVariables(const FactorGraph& graph) {
  std::vector<VariableId> ids;
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    if (graph.HasVariable(id) && !graph.IsConstant(id)) {
      ids.push_back(id);
    }
  }
  return ids;
}

DenseOracle::DenseOracle(const FactorGraph& graph, const std::vector<VariableId>& variables) {
  int num_columns = 0;
  const std::vector<int> column = ColumnsOf(graph, variables, &num_columns);
  const Maps maps(graph, column);
  int num_rows = 0;
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    num_rows += graph.NumFactors(id) * graph.family(id).residual_size();
  }
  J.setZero(num_rows, num_columns);
  f.resize(num_rows);
  int row = 0;
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    const FactorFamily& family = graph.family(id);
    const int size = family.residual_size();
    const FamilyRows rows = EvaluateFamily(graph, id, graph.state(), &maps);
    for (int i = 0; i < graph.NumFactors(id); ++i, row += size) {
      if (!graph.HasFactor(id, i)) {
        f.segment(row, size).setZero();
        continue;
      }
      f.segment(row, size) =
          Eigen::Map<const Eigen::VectorXd>(rows.residuals.data() + std::ptrdiff_t{i} * size, size);
      for (int s = 0; s < family.num_slots(); ++s) {
        const int first = column[static_cast<std::size_t>(graph.Variables(id, i)[s])];
        const int width = family.slot(s).tangent_size;
        if (first >= 0) {
          J.block(row, first, size, width) = Eigen::Map<const RowMajorMatrix>(
              rows.jacobians[static_cast<std::size_t>(s)].data() + std::ptrdiff_t{i} * size * width,
              size, width);
        }
      }
      cost += Correct(graph.loss(id, i), f.segment(row, size), J.middleRows(row, size));
    }
  }
  H = J.transpose() * J;
  g = J.transpose() * f;
}

double CostAt(const FactorGraph& graph, const std::vector<double>& state) {
  double cost = 0.0;
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    const int size = graph.family(id).residual_size();
    FamilyRows rows = EvaluateFamily(graph, id, state, nullptr);
    for (int i = 0; i < graph.NumFactors(id); ++i) {
      if (!graph.HasFactor(id, i)) {
        continue;
      }
      Eigen::Map<Eigen::VectorXd> f(rows.residuals.data() + std::ptrdiff_t{i} * size, size);
      Eigen::MatrixXd nothing(size, 0);
      cost += Correct(graph.loss(id, i), f, nothing);
    }
  }
  return cost;
}

double RelativeError(const Eigen::MatrixXd& actual, const Eigen::MatrixXd& expected) {
  const double norm = expected.norm();
  return (actual - expected).norm() / (norm > 0.0 ? norm : 1.0);
}

}  // namespace inceres::test
