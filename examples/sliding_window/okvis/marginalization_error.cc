#include "okvis/marginalization_error.h"

#include <algorithm>

#include "common/linearize.h"

namespace sliding_window {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

// sqrt(diag H), so that meters, radians and their rates are weighed alike where eigenvalues are
// judged.
VectorXd ScaleOf(const MatrixXd& H) {
  return (H.diagonal().array() > 1e-9).select(H.diagonal().array().max(0.0).sqrt(), 1e-3);
}

NormalEquations Scaled(const NormalEquations& equations, const VectorXd& scale) {
  const VectorXd inverse = scale.cwiseInverse();
  return {inverse.asDiagonal() * equations.H * inverse.asDiagonal(),
          inverse.cwiseProduct(equations.b)};
}

}  // namespace

const MarginalizationError::Block* MarginalizationError::Find(const double* address) const {
  const auto found = std::find_if(blocks_.begin(), blocks_.end(),
                                  [=](const Block& block) { return block.address == address; });
  return found == blocks_.end() ? nullptr : &*found;
}

int MarginalizationError::FindOrConnect(double* address, int size,
                                        const ceres::Manifold* manifold) {
  if (const Block* known = Find(address)) {
    return static_cast<int>(known - blocks_.data());
  }
  const auto offset = static_cast<int>(equations_.b.size());
  blocks_.push_back({address, {address, address + size}, manifold, offset});
  const int new_size = offset + blocks_.back().tangent_size();
  NormalEquations larger = NormalEquations::Zero(new_size);
  larger.H.topLeftCorner(offset, offset) = equations_.H;
  larger.b.head(offset) = equations_.b;
  equations_ = std::move(larger);
  return static_cast<int>(blocks_.size()) - 1;
}

void MarginalizationError::Add(const ceres::Problem& problem, ceres::ResidualBlockId residual) {
  std::vector<double*> addresses;
  problem.GetParameterBlocksForResidualBlock(residual, &addresses);
  std::vector<int> connected;  // into blocks_, -1 for a constant
  connected.reserve(addresses.size());
  for (double* address : addresses) {
    connected.push_back(problem.IsParameterBlockConstant(address)
                            ? -1
                            : FindOrConnect(address, problem.ParameterBlockSize(address),
                                            problem.GetManifold(address)));
  }
  std::vector<const double*> x;
  x.reserve(addresses.size());
  for (std::size_t i = 0; i < addresses.size(); ++i) {
    x.push_back(connected[i] < 0 ? addresses[i] : blocks_[connected[i]].x_0.data());
  }
  const LinearizedFactor factor = Linearize(*problem.GetCostFunctionForResidualBlock(residual),
                                            problem.GetLossFunctionForResidualBlock(residual), x);
  std::vector<std::pair<int, MatrixXd>> J;  // tangent, by the place of its rows
  for (std::size_t i = 0; i < factor.J.size(); ++i) {
    if (connected[i] < 0) {
      continue;
    }
    const Block& block = blocks_[connected[i]];
    RowMajorMatrix plus = RowMajorMatrix::Identity(factor.J[i].cols(), block.tangent_size());
    if (block.manifold != nullptr) {
      block.manifold->PlusJacobian(x[i], plus.data());
    }
    J.emplace_back(block.offset, factor.J[i] * plus);
  }
  for (const auto& [row, J_row] : J) {
    equations_.b.segment(row, J_row.cols()) += J_row.transpose() * factor.r;
    for (const auto& [column, J_column] : J) {
      equations_.H.block(row, column, J_row.cols(), J_column.cols()) +=
          J_row.transpose() * J_column;
    }
  }
}

void MarginalizationError::MarginalizeOut(const std::vector<double*>& leaving) {
  const auto stays = std::stable_partition(blocks_.begin(), blocks_.end(), [&](const Block& block) {
    return std::find(leaving.begin(), leaving.end(), block.address) != leaving.end();
  });
  if (stays == blocks_.begin()) {
    return;
  }
  std::vector<Eigen::Index> order;  // of the rows, what leaves first
  int num_dropped = 0;
  for (auto block = blocks_.begin(); block != blocks_.end(); ++block) {
    const int offset = static_cast<int>(order.size());
    for (int i = 0; i < block->tangent_size(); ++i) {
      order.push_back(block->offset + i);
    }
    num_dropped += block < stays ? block->tangent_size() : 0;
    block->offset = offset;
  }
  const NormalEquations ordered{equations_.H(order, order), equations_.b(order)};
  const VectorXd scale = ScaleOf(ordered.H);
  const NormalEquations scaled = Scaled(ordered, scale);
  equations_ = MarginalizeFirst(scaled, num_dropped,
                                RoundingError(scaled.H.topLeftCorner(num_dropped, num_dropped)));
  equations_ = Scaled(equations_, scale.tail(equations_.b.size()).cwiseInverse());
  blocks_.erase(blocks_.begin(), stays);
  for (Block& block : blocks_) {
    block.offset -= num_dropped;
  }
}

void MarginalizationError::Update() {
  const VectorXd scale = ScaleOf(equations_.H);
  const NormalEquations scaled = Scaled(equations_, scale);
  prior_ = TakeSquareRoot(scaled, RoundingError(scaled.H));
  prior_.J *= scale.asDiagonal();
  set_num_residuals(static_cast<int>(prior_.r.size()));
  mutable_parameter_block_sizes()->clear();
  for (const Block& block : blocks_) {
    mutable_parameter_block_sizes()->push_back(static_cast<int>(block.x_0.size()));
  }
}

std::vector<double*> MarginalizationError::Blocks() const {
  std::vector<double*> addresses;
  for (const Block& block : blocks_) {
    addresses.push_back(block.address);
  }
  return addresses;
}

bool MarginalizationError::Evaluate(double const* const* parameters, double* residuals,
                                    double** jacobians) const {
  const Eigen::Index n = prior_.r.size();
  VectorXd dx(n);
  for (std::size_t i = 0; i < blocks_.size(); ++i) {
    const Block& block = blocks_[i];
    const auto size = static_cast<Eigen::Index>(block.x_0.size());
    const auto J_tangent = prior_.J.middleCols(block.offset, block.tangent_size());
    double* jacobian = jacobians != nullptr ? jacobians[i] : nullptr;
    if (block.manifold == nullptr) {
      dx.segment(block.offset, size) = Eigen::Map<const VectorXd>(parameters[i], size) -
                                       Eigen::Map<const VectorXd>(block.x_0.data(), size);
      if (jacobian != nullptr) {
        Eigen::Map<RowMajorMatrix>(jacobian, n, size) = J_tangent;
      }
      continue;
    }
    block.manifold->Minus(parameters[i], block.x_0.data(), dx.data() + block.offset);
    if (jacobian != nullptr) {
      RowMajorMatrix minus(block.tangent_size(), size);
      block.manifold->MinusJacobian(block.x_0.data(), minus.data());
      Eigen::Map<RowMajorMatrix>(jacobian, n, size) = J_tangent * minus;
    }
  }
  Eigen::Map<VectorXd>(residuals, n) = prior_.J * dx + prior_.r;
  return true;
}

}  // namespace sliding_window
