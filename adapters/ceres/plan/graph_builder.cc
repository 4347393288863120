#include <algorithm>
#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <ceres/cost_function.h>

#include "adapters/ceres/plan/graph_plan.h"
#include "adapters/ceres/read/ceres_adapters.h"
#include "adapters/ceres/read/index.h"
#include "inceres/problem/ambient_family.h"
#include "src/base/aligned_vector.h"
#include "src/base/executor.h"

namespace inceres::internal {
namespace {

constexpr int kCostGrain = 1 << 14;

// Cost functions that the problem keeps, of one shape: a CeresCostFamily that owns none of them
// takes half of its memory.
class BorrowedCosts final : public AmbientFamily<BorrowedCosts> {
 public:
  BorrowedCosts(int residual_size, std::vector<Slot> slots,
                UnwrittenVector<const ceres::CostFunction*> costs)
      : AmbientFamily<BorrowedCosts>(residual_size, std::move(slots)), costs_(std::move(costs)) {}

  int size() const override { return static_cast<int>(costs_.size()); }
  const char* Name() const override { return "ceres::CostFunction"; }
  std::string Describe(int i) const override { return DescribeObject("cost function", &at(i)); }

  // Two lines of it, and the one before, where the allocator has mostly put what it was made of:
  // new AutoDiffCostFunction<F, ...>(new F(...)).
  void Prefetch(int i) const {
    constexpr std::ptrdiff_t kLine = 64;
    const auto* const line = reinterpret_cast<const char*>(costs_[At(i)]);
    __builtin_prefetch(line - kLine);
    __builtin_prefetch(line);
    __builtin_prefetch(line + kLine - 1);
  }
  bool EvaluateOne(int i, const double* const* parameters, double* residuals,
                   double** jacobians) const {
    return at(i).Evaluate(parameters, residuals, jacobians);
  }

 private:
  const ceres::CostFunction& at(int i) const { return *costs_[At(i)]; }

  UnwrittenVector<const ceres::CostFunction*> costs_;
};

class Builder {
 public:
  Builder(const ProblemView& view, const GraphPlan& plan, const MakeFamily& make_family,
          int num_threads, FactorGraph* graph)
      : view_(view),
        plan_(plan),
        make_family_(make_family),
        num_threads_(num_threads),
        has_losses_(std::any_of(view.residuals.begin(), view.residuals.end(),
                                [](const auto& residual) { return residual.loss != nullptr; })),
        graph_(*graph) {}

  std::vector<StateBlock> Run() {
    graph_.Reserve(static_cast<int>(plan_.blocks.size()), view_.reduced.num_parameters);
    state_blocks_.reserve(At(view_.reduced.num_parameter_blocks));
    for (const int b : plan_.blocks) {
      AddVariable(b);
    }
    for (const GraphPlan::Family& family : plan_.families) {
      AddFamily(family);
    }
    return std::move(state_blocks_);
  }

 private:
  void AddVariable(int b) {
    const ParameterBlockView& block = view_.block(b);
    if (block.constant) {
      graph_.AddBorrowedConstant(block.values, block.ambient_size);
      return;
    }
    const Role role = plan_.landmarks.Contains(b) ? Role::kLandmark : Role::kFrame;
    const VariableId id =
        graph_.AddVariable(block.values, block.ambient_size, role, manifolds_.Get(block.manifold));
    if (block.bounds != BoundsKind::kNone) {
      const double* lower = view_.bounds.data() + block.first_bound;
      graph_.SetBounds(id, lower, lower + block.ambient_size);
    }
    state_blocks_.push_back({block.values, graph_.StateOffset(id), block.ambient_size});
  }

  std::shared_ptr<const FactorFamily> CostsOf(const GraphPlan::Family& family) const {
    if (make_family_) {
      return make_family_(view_, family);
    }
    UnwrittenVector<const ceres::CostFunction*> costs(family.residuals.size());
    Executor(num_threads_).For(static_cast<int>(costs.size()), kCostGrain, [&](int begin, int end) {
      for (int k = begin; k < end; ++k) {
        costs[At(k)] = view_.residuals[At(family.residuals[At(k)])].cost;
      }
    });
    return std::make_shared<BorrowedCosts>(family.shape.num_residuals, family.shape.slots,
                                           std::move(costs));
  }

  void AddFamily(const GraphPlan::Family& family) {
    const std::size_t num_factors = family.residuals.size();
    std::vector<std::shared_ptr<const Loss>> losses;  // none, or one for each factor
    for (std::size_t k = 0; has_losses_ && k < num_factors; ++k) {
      const ResidualBlockView& residual = view_.residuals[At(family.residuals[k])];
      if (residual.loss != nullptr) {
        losses.resize(num_factors);
        losses[k] = losses_.Get(residual.loss);
      }
    }
    graph_.ConnectMany(graph_.AddFamily(CostsOf(family)), family.variables, std::move(losses));
  }

  const ProblemView& view_;
  const GraphPlan& plan_;
  const MakeFamily& make_family_;
  const int num_threads_;
  const bool has_losses_;
  FactorGraph& graph_;
  ManifoldTable manifolds_;
  AdapterTable<Loss, CeresLoss, ceres::LossFunction> losses_;
  std::vector<StateBlock> state_blocks_;
};

}  // namespace

std::vector<StateBlock> BuildGraph(const ProblemView& view, const GraphPlan& plan,
                                   FactorGraph* graph, const MakeFamily& make_family,
                                   int num_threads) {
  return Builder(view, plan, make_family, num_threads, graph).Run();
}

void NameVariables(const std::vector<StateBlock>& blocks, FactorGraph* graph) {
  graph->SetVariableNames([&blocks, graph](VariableId id) {
    const double* user = graph->Values(id);  // of a borrowed constant
    const std::int64_t offset = graph->StateOffset(id);
    if (offset >= 0) {
      const auto at = [](const StateBlock& block, std::int64_t wanted) {
        return block.offset < wanted;
      };
      user = std::lower_bound(blocks.begin(), blocks.end(), offset, at)->user;
    }
    return DescribeObject("parameter block", user);
  });
}

void WriteToUser(const std::vector<StateBlock>& blocks, const double* state) {
  for (const StateBlock& block : blocks) {
    std::copy_n(state + block.offset, block.size, block.user);
  }
}

}  // namespace inceres::internal
