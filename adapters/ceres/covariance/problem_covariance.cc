#include "adapters/ceres/covariance/problem_covariance.h"

#include <algorithm>
#include <limits>
#include <memory>
#include <set>
#include <utility>

#include <Eigen/Core>
#include <glog/logging.h>

#include "adapters/ceres/plan/graph_plan.h"
#include "adapters/ceres/plan/structure_cache.h"
#include "adapters/ceres/read/index.h"
#include "adapters/ceres/read/ordering.h"
#include "inceres/solver/covariance.h"

namespace inceres::internal {
namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using ConstRowMajor = Eigen::Map<const RowMajor>;

// Variances inflated by more than this have lost half of their digits in the normal equations: the
// QR of the Jacobian has the word. Beyond the second they count as infinite.
constexpr double kTrustedInflation = 1e8;
constexpr double kHopelessInflation = 1e12;

// Its covariances are zeros, as in Ceres: nothing moves it, or no residual block touches it.
bool IsKnown(const ParameterBlockView& block) {
  return block.constant || block.degree == 0;
}

std::string NameOf(const ProblemView& view, int block) {
  return Describe(view.blocks[At(block)]);
}

// The graph's variables by their parameter blocks.
std::string DescribeDeficiency(const RankDeficiency& open, const ProblemView& view,
                               const GraphPlan& plan) {
  std::string text;
  if (!open.landmarks.empty()) {
    text = std::to_string(open.landmarks.size()) +
           " parameter blocks are not determined by their own residual blocks, among them " +
           NameOf(view, plan.blocks[At(open.landmarks.front())]);
  }
  if (!open.directions.empty()) {
    text += (text.empty() ? "" : "; ") + open.CountDirections();
  }
  const char* separator = ", which move ";
  for (const RankDeficiency::Direction& direction : open.directions) {
    if (!direction.shares.empty()) {
      text += separator + NameOf(view, plan.blocks[At(direction.shares.front().first)]);
      separator = "; ";
    }
  }
  return text;
}

// With the rank rule of SuiteSparseQR, SPQR_DEFAULT_TOL. Fixed residual blocks are rows of zeros in
// Ceres's Jacobian, and count.
GraphCovariance ByRows(CovarianceOptions options, const ProblemView& view) {
  options.algorithm = CovarianceAlgorithm::kQr;
  options.min_column_remainder = std::min(
      0.5,
      20.0 * (static_cast<double>(view.all.num_residuals) + view.reduced.num_effective_parameters) *
          std::numeric_limits<double>::epsilon());
  return GraphCovariance(options);
}

// Singular values that Ceres's Jacobian has and ours has not: where there are fewer rows than
// columns, fixed residual blocks, rows of zeros, make zeros of as many.
int NumZerosOfFixed(const ProblemView& view) {
  const int num_columns = view.reduced.num_effective_parameters;
  return std::min(view.all.num_residuals, num_columns) -
         std::min(view.reduced.num_residuals, num_columns);
}

std::string CountZerosOfFixed(int num_zeros) {
  return std::to_string(num_zeros) +
         " singular values are zero, since residual blocks touch no variable";
}

// What is open where the QR of the Jacobian, which can name landmarks only, has come out singular.
// `core`: with the inflation that counts as infinite.
RankDeficiency FindOpen(const GraphCovariance& by_rows, const GraphCovariance& by_normal_equations,
                        const CovarianceOptions& core, const FactorGraph& graph,
                        const GraphCovariance::Pairs& wanted) {
  if (!by_rows.deficiency().landmarks.empty()) {
    return by_rows.deficiency();
  }
  GraphCovariance hopeless(core);
  const bool is_open = hopeless.Compute(graph, wanted).code == StatusCode::kSingular;
  return (is_open ? hopeless : by_normal_equations).deficiency();
}

// By normal equations, and by rows where these have lost too many digits. *open: what is, of
// kSingular.
Status ComputeSparse(const ceres::Covariance::Options& options, const ProblemView& view,
                     const FactorGraph& graph, const GraphCovariance::Pairs& wanted,
                     GraphCovariance* covariance, RankDeficiency* open) {
  CovarianceOptions core;
  core.num_threads = std::max(1, options.num_threads);
  core.max_inflation = kTrustedInflation;
  *covariance = GraphCovariance(core);
  Status status = covariance->Compute(graph, wanted);
  if (status.code == StatusCode::kSingular) {
    core.max_inflation = kHopelessInflation;
    const GraphCovariance by_normal_equations = std::exchange(*covariance, ByRows(core, view));
    status = covariance->Compute(graph, wanted);
    if (status.code == StatusCode::kSingular) {
      *open = FindOpen(*covariance, by_normal_equations, core, graph, wanted);
    }
  }
  return status;
}

// The zeros of fixed residual blocks are the smallest singular values, the first to be left out.
Status ComputeDense(const ceres::Covariance::Options& options, const ProblemView& view,
                    const FactorGraph& graph, const GraphCovariance::Pairs& wanted,
                    GraphCovariance* covariance) {
  CovarianceOptions core;
  core.num_threads = std::max(1, options.num_threads);
  core.algorithm = CovarianceAlgorithm::kDenseSvd;
  core.min_reciprocal_condition_number = options.min_reciprocal_condition_number;
  const int num_zeros = options.null_space_rank < 0 ? 0 : NumZerosOfFixed(view);
  core.null_space_rank = std::max(-1, options.null_space_rank - num_zeros);
  if (num_zeros > options.null_space_rank && num_zeros > 0 && !wanted.empty()) {
    return Status::Error(StatusCode::kSingular,
                         "the Jacobian is rank deficient: " + CountZerosOfFixed(num_zeros) +
                             ", more than null_space_rank leaves out");
  }
  *covariance = GraphCovariance(core);
  Status status = covariance->Compute(graph, wanted);
  if (status.code == StatusCode::kSingular && num_zeros > 0) {
    status.message += "; " + CountZerosOfFixed(num_zeros) + ", and left out before";
  }
  return status;
}

}  // namespace

ProblemCovariance::Outcome ProblemCovariance::Decline(std::string why) {
  message_ = std::move(why);
  return Outcome::kDeclined;
}

ProblemCovariance::Outcome ProblemCovariance::Fail(std::string why) {
  message_ = std::move(why);
  LOG(ERROR) << "inceres: no covariance: " << message_;
  return Outcome::kFailed;
}

// What Ceres ends the process for.
std::string ProblemCovariance::FindMisuse(const ProblemView& view, const Pairs& pairs) {
  std::set<std::pair<const double*, const double*>> seen;
  for (const auto& pair : pairs) {
    if (!seen.insert(pair).second) {
      return "a pair of parameter blocks is there twice";
    }
    for (const double* values : {pair.first, pair.second}) {
      if (view.index.Find(values) < 0) {
        return "a parameter block is not the problem's";
      }
    }
  }
  return "";
}

// Options that are out of range.
std::string ProblemCovariance::FindRankRule(const ceres::Covariance::Options& options) {
  const double smallest = options.min_reciprocal_condition_number;
  return options.null_space_rank >= -1 && smallest >= 0.0 && smallest < 1.0
             ? ""
             : "DENSE_SVD with options out of range";
}

void ProblemCovariance::RememberBlocks(const ProblemView& view, const Pairs& pairs) {
  blocks_.reserve(view.blocks.size());
  for (const ParameterBlockView& block : view.blocks) {
    blocks_.push_back({block.values, block.ambient_size, block.tangent_size});
  }
  for (const auto& pair : pairs) {
    for (const double* values : {pair.first, pair.second}) {
      const ParameterBlockView& block = view.block(view.index.Find(values));
      if (block.manifold == nullptr || IsKnown(block)) {
        continue;
      }
      const auto [kept, is_new] = plus_jacobians_.try_emplace(values);
      if (is_new) {
        kept->second.resize(At(block.ambient_size) * At(block.tangent_size));
        PlusJacobianOf(*block.manifold, values, kept->second.data());
      }
    }
  }
}

ProblemCovariance::Outcome ProblemCovariance::Compute(const ceres::Covariance::Options& options,
                                                      const Pairs& pairs,
                                                      const ceres::Problem& problem,
                                                      ceres::EvaluationCallback* callback) {
  blocks_.clear();
  plus_jacobians_.clear();
  covariance_ = GraphCovariance();
  message_.clear();
  ProblemView view;
  Introspect(problem, &view, std::max(1, options.num_threads), /*may_have_bounds=*/false);
  if (!view.defect.empty()) {
    return Decline(view.defect);
  }
  std::string misuse = FindMisuse(view, pairs);
  if (misuse.empty() && options.algorithm_type == ceres::DENSE_SVD) {
    misuse = FindRankRule(options);
  }
  if (!misuse.empty()) {
    return Decline(misuse);
  }
  RememberBlocks(view, pairs);
  if (view.reduced.num_parameter_blocks == 0) {
    return Outcome::kComputed;
  }
  if (!options.apply_loss_function) {
    for (ResidualBlockView& residual : view.residuals) {
      residual.loss = nullptr;
    }
  }
  if (callback != nullptr) {
    callback->PrepareForEvaluation(/*evaluate_jacobians=*/true, /*new_evaluation_point=*/true);
  }
  return ComputeMoving(options, pairs, &view);
}

GraphCovariance::Pairs ProblemCovariance::MovingPairs(const ProblemView& view,
                                                      const GraphPlan& plan, const Pairs& pairs) {
  for (std::size_t id = 0; id < plan.blocks.size(); ++id) {
    const int block = plan.blocks[id];
    if (!IsKnown(view.block(block))) {
      blocks_[At(block)].variable = static_cast<VariableId>(id);
    }
  }
  GraphCovariance::Pairs moving;
  for (const auto& pair : pairs) {
    const VariableId a = FindBlock(pair.first)->variable, b = FindBlock(pair.second)->variable;
    if (a >= 0 && b >= 0) {
      moving.emplace_back(a, b);
    }
  }
  return moving;
}

ProblemCovariance::Outcome ProblemCovariance::ComputeMoving(
    const ceres::Covariance::Options& options, const Pairs& pairs, ProblemView* view) {
  const OrderingView ordering;
  std::shared_ptr<GraphPlan> own;
  const std::shared_ptr<const GraphPlan> plan =
      StructureCache::OfProcess().PlanFor(*view, ordering, ceres::SPARSE_SCHUR, &own);
  if (!plan->landmarks.obstacle.empty()) {
    return Decline(plan->landmarks.obstacle);
  }
  FactorGraph graph;
  const std::vector<StateBlock> state = BuildGraph(*view, *plan, &graph);
  NameVariables(state, &graph);
  const GraphCovariance::Pairs wanted = MovingPairs(*view, *plan, pairs);
  Status status;
  if (options.algorithm_type == ceres::DENSE_SVD) {
    status = ComputeDense(options, *view, graph, wanted, &covariance_);
  } else {
    RankDeficiency open;
    status = ComputeSparse(options, *view, graph, wanted, &covariance_, &open);
    if (status.code == StatusCode::kSingular) {
      status.message.insert(0, DescribeDeficiency(open, *view, *plan) + " (");
      status.message += ')';
    }
  }
  if (status.code == StatusCode::kSingular) {
    return Fail(status.message);
  }
  if (!status.ok()) {
    return status.code == StatusCode::kEvaluationFailed ? Fail(status.message)
                                                        : Decline(status.message);
  }
  return Outcome::kComputed;
}

ProblemCovariance::Pairs ProblemCovariance::AllPairs(const std::vector<const double*>& blocks) {
  Pairs pairs;
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    for (std::size_t j = i; j < blocks.size(); ++j) {
      pairs.emplace_back(blocks[i], blocks[j]);
    }
  }
  return pairs;
}

const ProblemCovariance::BlockOfUser* ProblemCovariance::FindBlock(const double* values) const {
  const auto found = std::lower_bound(
      blocks_.begin(), blocks_.end(), values,
      [](const BlockOfUser& block, const double* wanted) { return block.values < wanted; });
  return found != blocks_.end() && found->values == values ? &*found : nullptr;
}

// J_a cov J_bᵀ.
void ProblemCovariance::Lift(const BlockOfUser& a, const BlockOfUser& b,
                             const std::vector<double>& tangent, double* covariance) const {
  RowMajor lifted = ConstRowMajor(tangent.data(), a.tangent_size, b.tangent_size);
  if (const auto J = plus_jacobians_.find(a.values); J != plus_jacobians_.end()) {
    lifted = (ConstRowMajor(J->second.data(), a.ambient_size, a.tangent_size) * lifted).eval();
  }
  if (const auto J = plus_jacobians_.find(b.values); J != plus_jacobians_.end()) {
    lifted = (lifted * ConstRowMajor(J->second.data(), b.ambient_size, b.tangent_size).transpose())
                 .eval();
  }
  std::copy_n(lifted.data(), lifted.size(), covariance);
}

bool ProblemCovariance::GetBlock(const double* a, const double* b, bool ambient,
                                 double* covariance) const {
  const BlockOfUser* const block_a = FindBlock(a);
  const BlockOfUser* const block_b = FindBlock(b);
  const bool known = block_a != nullptr && block_b != nullptr;
  if (known && (block_a->variable < 0 || block_b->variable < 0)) {
    const auto size = [ambient](const BlockOfUser& block) {
      return At(ambient ? block.ambient_size : block.tangent_size);
    };
    std::fill_n(covariance, size(*block_a) * size(*block_b), 0.0);
    return true;
  }
  std::vector<double> tangent(known ? At(block_a->tangent_size) * At(block_b->tangent_size) : 0);
  if (!known || !covariance_.Get(block_a->variable, block_b->variable, tangent.data())) {
    LOG(ERROR) << "Unable to find covariance block for " << a << " " << b;
    return false;
  }
  if (ambient) {
    Lift(*block_a, *block_b, tangent, covariance);
  } else {
    std::copy(tangent.begin(), tangent.end(), covariance);
  }
  return true;
}

bool ProblemCovariance::GetMatrix(const std::vector<const double*>& blocks, bool ambient,
                                  double* covariance) const {
  std::vector<int> offsets = {0};
  for (const double* block : blocks) {
    const BlockOfUser* const found = FindBlock(block);
    if (found == nullptr) {
      LOG(ERROR) << "Unable to find parameter block " << block << " in the problem.";
      return false;
    }
    offsets.push_back(offsets.back() + (ambient ? found->ambient_size : found->tangent_size));
  }
  Eigen::Map<RowMajor> whole(covariance, offsets.back(), offsets.back());
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    for (std::size_t j = 0; j < blocks.size(); ++j) {
      RowMajor part(offsets[i + 1] - offsets[i], offsets[j + 1] - offsets[j]);
      if (!GetBlock(blocks[i], blocks[j], ambient, part.data())) {
        return false;
      }
      whole.block(offsets[i], offsets[j], part.rows(), part.cols()) = part;
    }
  }
  return true;
}

}  // namespace inceres::internal
