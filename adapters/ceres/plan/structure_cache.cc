#include "adapters/ceres/plan/structure_cache.h"

#include "adapters/ceres/plan/landmark_selection.h"
#include "adapters/ceres/plan/option_mapping.h"
#include "adapters/ceres/read/factor_shapes.h"

namespace inceres::internal {
namespace {

// All that the plan of a graph depends on, in numbers: sizes of the blocks, blocks of the residual
// blocks, landmarks the user has named, and an order of frames that matters. Neither values nor
// anything of the user's.
class Fingerprint {
 public:
  Fingerprint(const ProblemView& view, const OrderingView& ordering, ceres::LinearSolverType type)
      : type_(type),
        landmarks_are_given_(LandmarksAreGiven(ordering, type)),
        numbers_frames_(ordering.numbers_frames),
        residuals_(view.residuals.begin(), view.residuals.end()),
        slots_(view.slots) {
    if (landmarks_are_given_) {
      first_group_ = ordering.first_group;
    }
    if (numbers_frames_) {
      later_groups_ = ordering.later_groups;
    }
    blocks_.reserve(view.blocks.size());
    for (const ParameterBlockView& block : view.blocks) {
      blocks_.push_back({block.ambient_size, block.tangent_size, block.constant});
    }
  }

  // Cost: linear in slots, without an allocation.
  bool IsThatOf(const ProblemView& view, const OrderingView& ordering,
                ceres::LinearSolverType type) const {
    const auto is_block = [](const Block& a, const ParameterBlockView& b) {
      return a.ambient_size == b.ambient_size && a.tangent_size == b.tangent_size &&
             a.constant == b.constant;
    };
    const auto is_residual = [](const ResidualBlockShape& a, const ResidualBlockShape& b) {
      return a.num_residuals == b.num_residuals && a.first_slot == b.first_slot &&
             a.num_slots == b.num_slots;
    };
    return type_ == type && landmarks_are_given_ == LandmarksAreGiven(ordering, type) &&
           (!landmarks_are_given_ || first_group_ == ordering.first_group) &&
           numbers_frames_ == ordering.numbers_frames &&
           (!numbers_frames_ || later_groups_ == ordering.later_groups) && slots_ == view.slots &&
           std::equal(blocks_.begin(), blocks_.end(), view.blocks.begin(), view.blocks.end(),
                      is_block) &&
           std::equal(residuals_.begin(), residuals_.end(), view.residuals.begin(),
                      view.residuals.end(), is_residual);
  }

 private:
  struct Block {
    int ambient_size;
    int tangent_size;
    bool constant;
  };

  ceres::LinearSolverType type_;
  bool landmarks_are_given_;
  bool numbers_frames_;
  std::vector<int> first_group_;   // of landmarks that are given
  std::vector<int> later_groups_;  // where their order matters
  std::vector<Block> blocks_;      // by address, as in the view
  std::vector<ResidualBlockShape> residuals_;
  std::vector<int> slots_;
};

}  // namespace

struct StructureCache::KnownPlan {
  Fingerprint structure;
  GraphPlan plan;
};

StructureCache& StructureCache::OfProcess() {
  static auto& kCache = *new StructureCache;
  return kCache;
}

std::unique_ptr<ProblemView> StructureCache::TakeView() {
  std::unique_ptr<ProblemView> view = views_.Take([](const ProblemView&) { return true; });
  return view != nullptr ? std::move(view) : std::make_unique<ProblemView>();
}

void StructureCache::GiveBack(std::unique_ptr<ProblemView> view) {
  if (view->IsSmall()) {
    view->Clear();
    views_.Put(std::move(view));
  }
}

std::shared_ptr<const GraphPlan> StructureCache::PlanFor(const ProblemView& view,
                                                         const OrderingView& ordering,
                                                         ceres::LinearSolverType type,
                                                         std::shared_ptr<GraphPlan>* own,
                                                         int num_threads) {
  const bool is_small = view.residuals.size() + view.slots.size() <= kMaxNumbers;
  std::shared_ptr<const KnownPlan> known;
  if (is_small) {
    known = plans_.Share(
        [&](const KnownPlan& plan) { return plan.structure.IsThatOf(view, ordering, type); });
  }
  if (known == nullptr) {
    const ShapeTable shapes = FindShapes(view);
    bool depends_on_memory = false;  // of which there may be more or less another time
    const auto available = [&depends_on_memory] {
      depends_on_memory = true;
      return AvailableBytes();
    };
    GraphPlan plan = PlanGraph(
        view, shapes, SelectLandmarks(view, ordering, shapes, type, available, num_threads),
        num_threads);
    if (!is_small || depends_on_memory || !plan.landmarks.obstacle.empty()) {
      *own = std::make_shared<GraphPlan>(std::move(plan));
      return *own;
    }
    known = std::make_shared<const KnownPlan>(
        KnownPlan{Fingerprint(view, ordering, type), std::move(plan)});
    plans_.Put(known);
  }
  return {known, &known->plan};
}

std::unique_ptr<Solver> StructureCache::TakeSolver(const SolverOptions& options,
                                                   const FactorGraph& graph) {
  std::unique_ptr<Solver> solver =
      solvers_.Take([&](const Solver& kept) { return kept.IsReadyFor(options, graph); });
  return solver != nullptr ? std::move(solver) : std::make_unique<Solver>(kMaxSolverBytes);
}

void StructureCache::GiveBack(std::unique_ptr<Solver> solver) {
  if (solver->Bytes() > 0) {
    solvers_.Put(std::move(solver));
  }
}

void StructureCache::Clear() {
  views_.Clear();
  plans_.Clear();
  solvers_.Clear();
}

std::string ChoosePlan(ceres::LinearSolverType type, SolveInput* input) {
  if (input->view.reduced.num_parameter_blocks == 0) {
    return "";
  }
  input->plan = StructureCache::OfProcess().PlanFor(input->view, input->ordering, type,
                                                    &input->own_plan, NumReaders(input->options));
  return input->plan->landmarks.obstacle;
}

}  // namespace inceres::internal
