#include "tools/fuzz/life.h"

#include <algorithm>
#include <cstdio>
#include <memory>
#include <utility>

#include "tools/fuzz/ingredients.h"

namespace inceres::fuzz {
namespace {

constexpr double kBurstChance = 0.05;  // many edits before the next solve
constexpr double kQuietChance = 0.1;   // none
constexpr double kOptionsChance = 0.1;
constexpr double kResetChance = 0.02;

int NumEdits(Dice* dice) {
  if (dice->Chance(kQuietChance)) {
    return 0;
  }
  return dice->Chance(kBurstChance) ? dice->Int(10, 30) : dice->Int(1, 6);
}

// Points first, in a group of their own, as users of Schur solvers order them.
void OrderPointsFirst(const World& world, ceres::Solver::Options* options) {
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (const auto& block : world.blocks()) {
    ordering->AddElementToGroup(block->x, block->is_point ? 0 : 1);
  }
  options->linear_solver_ordering = ordering;
}

// No roll of the dice decides on what a flag has asked for: all else is as without it.
Recipe RecipeOf(const LifePlan& plan, bool follows_stock, Dice* dice) {
  Recipe recipe = plan.degenerate ? DegenerateRecipe(dice) : RandomRecipe(follows_stock, dice);
  recipe.bound_chance = plan.bounds ? 1.0 / 3.0 : recipe.bound_chance;
  return recipe;
}

// Edits and options of a life come from `chooses`, so that they do not depend on what the checks of
// a solve need dice for.
class Life {
 public:
  Life(const LifePlan& plan, Counts* counts)
      : plan_(plan),
        counts_(counts),
        chooses_(SeedOf(plan.seed, plan.life)),
        checks_(SeedOf(plan.seed + 1, plan.life)),
        solver_(MakeSolver(plan.mode)),
        range_{solver_->follows_stock()},
        world_(RecipeOf(plan, solver_->follows_stock(), &chooses_), &chooses_),
        options_(RandomOptions(range_, &chooses_)),
        orders_(chooses_.Chance(0.2)) {}

  std::optional<Defect> Run() {
    for (;;) {
      std::optional<Finding> finding = Solve();
      if (finding) {
        return Defect{plan_, edits_, solves_, *std::move(finding)};
      }
      if (edits_ >= plan_.max_edits) {
        return std::nullopt;
      }
      Edit();
    }
  }

 private:
  std::optional<Finding> Solve();
  void Edit();

  const LifePlan plan_;
  Counts* counts_;
  Dice chooses_;
  Dice checks_;
  std::unique_ptr<SolverUnderTest> solver_;
  OptionRange range_;
  World world_;
  ceres::Solver::Options options_;
  bool orders_;
  long edits_ = 0;
  long solves_ = 0;
};

std::optional<Finding> Life::Solve() {
  options_.linear_solver_ordering.reset();
  if (orders_ && !world_.blocks().empty()) {
    OrderPointsFirst(world_, &options_);
  }
  ++solves_;
  // The life's own options keep their threads, so that its dice fall alike for any limit.
  ceres::Solver::Options options = options_;
  options.num_threads = std::min(options.num_threads, plan_.max_threads);
  std::optional<Finding> finding =
      SolveAndCheck(options, plan_.judges, &world_, solver_.get(), &checks_, counts_);
  if (plan_.verbose) {
    std::printf("  solve %ld: %zu blocks, %zu factors%s\n", solves_, world_.blocks().size(),
                world_.factors().size(), finding ? " <- a defect" : "");
    std::fputs(finding ? finding->iterations.c_str() : "", stdout);
  }
  return finding;
}

void Life::Edit() {
  // At most up to max_edits, so that a life of fewer edits is a beginning of one of more.
  for (int count = NumEdits(&chooses_); count > 0 && edits_ < plan_.max_edits; --count) {
    const std::string what = world_.Edit();
    ++edits_;
    ++counts_->edits;
    if (plan_.verbose) {
      std::printf("  edit %ld: %s\n", edits_, what.c_str());
    }
  }
  if (chooses_.Chance(kOptionsChance)) {
    ChangeOptions(range_, &chooses_, &options_);
  }
  if (chooses_.Chance(kResetChance)) {
    solver_->Reset();
  }
}

}  // namespace

std::optional<Defect> Live(const LifePlan& plan, Counts* counts) {
  return Life(plan, counts).Run();
}

}  // namespace inceres::fuzz
