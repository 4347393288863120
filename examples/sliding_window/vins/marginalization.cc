#include "vins/marginalization.h"

#include "common/pose.h"
#include "common/schur_complement.h"

namespace sliding_window {

using Eigen::VectorXd;

namespace {

constexpr double kEigenvalueThreshold = 1e-8;

// x minus x_0 in the tangent space of a block.
VectorXd Difference(const MarginalizationInfo::Block& block, const double* x) {
  if (block.size != Pose::kSize) {
    return Eigen::Map<const VectorXd>(x, block.size) -
           Eigen::Map<const VectorXd>(block.x_0.data(), block.size);
  }
  const Pose pose = Pose::FromParameters(x);
  const Pose pose_0 = Pose::FromParameters(block.x_0.data());
  const Eigen::Quaterniond dq = pose_0.q.conjugate() * pose.q;
  VectorXd dx(Pose::kTangentSize);
  dx << pose.p - pose_0.p, (dq.w() < 0.0 ? -2.0 : 2.0) * dq.vec();
  return dx;
}

}  // namespace

void MarginalizationInfo::Add(const ceres::CostFunction& cost, const ceres::LossFunction* loss,
                              const std::vector<double*>& blocks, const std::vector<int>& dropped) {
  Factor factor{Linearize(cost, loss, {blocks.begin(), blocks.end()}), {}};
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    factor.blocks.push_back(FindOrAddBlock(blocks[i], cost.parameter_block_sizes()[i]));
  }
  for (const int i : dropped) {
    is_dropped_[factor.blocks[i]] = true;
  }
  factors_.push_back(std::move(factor));
}

int MarginalizationInfo::FindOrAddBlock(double* address, int size) {
  const auto [found, is_new] = block_at_.emplace(address, static_cast<int>(blocks_.size()));
  if (is_new) {
    blocks_.push_back({address,
                       size,
                       size == Pose::kSize ? Pose::kTangentSize : size,
                       -1,
                       {address, address + size}});
    is_dropped_.push_back(false);
  }
  return found->second;
}

int MarginalizationInfo::OrderBlocks() {
  int offset = 0;
  int num_dropped = 0;
  for (const bool dropped : {true, false}) {
    for (std::size_t i = 0; i < blocks_.size(); ++i) {
      if (is_dropped_[i] == dropped) {
        blocks_[i].offset = offset;
        offset += blocks_[i].tangent_size;
      }
    }
    num_dropped = dropped ? offset : num_dropped;
  }
  return num_dropped;
}

void MarginalizationInfo::Marginalize() {
  const int num_dropped = OrderBlocks();
  int size = 0;
  for (const Block& block : blocks_) {
    size += block.tangent_size;
  }
  NormalEquations all = NormalEquations::Zero(size);
  for (const Factor& factor : factors_) {
    const std::vector<RowMajorMatrix>& J = factor.linearized.J;
    for (std::size_t i = 0; i < J.size(); ++i) {
      const Block& row = blocks_[factor.blocks[i]];
      const auto J_i = J[i].leftCols(row.tangent_size);
      all.b.segment(row.offset, row.tangent_size) += J_i.transpose() * factor.linearized.r;
      for (std::size_t j = 0; j < J.size(); ++j) {
        const Block& column = blocks_[factor.blocks[j]];
        all.H.block(row.offset, column.offset, row.tangent_size, column.tangent_size) +=
            J_i.transpose() * J[j].leftCols(column.tangent_size);
      }
    }
  }
  factors_.clear();
  SquareRoot prior = TakeSquareRoot(MarginalizeFirst(all, num_dropped, kEigenvalueThreshold),
                                    kEigenvalueThreshold);
  J_ = std::move(prior.J);
  r_ = std::move(prior.r);
  for (std::size_t i = 0; i < blocks_.size(); ++i) {
    if (!is_dropped_[i]) {
      kept_.push_back(blocks_[i]);
      kept_.back().offset -= num_dropped;
    }
  }
}

std::vector<double*> MarginalizationInfo::KeptBlocks(
    const std::unordered_map<const double*, double*>& moved) const {
  std::vector<double*> addresses;
  for (const Block& block : kept_) {
    const auto found = moved.find(block.address);
    addresses.push_back(found != moved.end() ? found->second : block.address);
  }
  return addresses;
}

MarginalizationFactor::MarginalizationFactor(const MarginalizationInfo* info) : info_(info) {
  set_num_residuals(static_cast<int>(info->r().size()));
  for (const MarginalizationInfo::Block& block : info->kept()) {
    mutable_parameter_block_sizes()->push_back(block.size);
  }
}

bool MarginalizationFactor::Evaluate(double const* const* parameters, double* residuals,
                                     double** jacobians) const {
  const Eigen::Index n = info_->r().size();
  VectorXd dx(n);
  for (std::size_t i = 0; i < info_->kept().size(); ++i) {
    const MarginalizationInfo::Block& block = info_->kept()[i];
    dx.segment(block.offset, block.tangent_size) = Difference(block, parameters[i]);
    if (jacobians != nullptr && jacobians[i] != nullptr) {
      Eigen::Map<RowMajorMatrix> J(jacobians[i], n, block.size);
      J.leftCols(block.tangent_size) = info_->J().middleCols(block.offset, block.tangent_size);
      J.rightCols(block.size - block.tangent_size).setZero();
    }
  }
  Eigen::Map<VectorXd>(residuals, n) = info_->J() * dx + info_->r();
  return true;
}

}  // namespace sliding_window
