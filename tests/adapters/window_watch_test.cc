// When a session's solve is exact: windows that slide, and what exact solves do for less.
#include "adapters/ceres/session/window_watch.h"

#include <memory>
#include <vector>

#include <ceres/problem.h>
#include <gtest/gtest.h>

#include "adapters/ceres/read/introspection.h"
#include "adapters/ceres/session/mode_choice.h"
#include "inceres/ceres/session.h"
#include "support/ceres_lambdas.h"

namespace inceres::internal {
namespace {

ceres::CostFunction* Nothing(const std::vector<int>& sizes) {
  return new lambdas::Cost(1, sizes, [](double const* const*, double* residuals, double**) {
    residuals[0] = 0.0;
    return true;
  });
}

// States of six in a chain, each seen with the next.
class Chain {
 public:
  void AddState() {
    states_.push_back(std::make_unique<std::vector<double>>(6, 0.0));
    const std::size_t n = states_.size();
    if (n > 1) {
      problem_.AddResidualBlock(Nothing({6, 6}), nullptr, states_[n - 2]->data(),
                                states_[n - 1]->data());
    }
  }
  void AddPrior(std::size_t state) {
    problem_.AddResidualBlock(Nothing({6}), nullptr, states_[state]->data());
  }
  void RemoveFirst() {
    problem_.RemoveParameterBlock(states_.front()->data());
    removed_.push_back(std::move(states_.front()));  // its address is not another's
    states_.erase(states_.begin());
  }
  bool Look(WindowWatch* watch) {
    Introspect(problem_, &view_);
    return watch->WantsExact(view_);
  }

 private:
  std::vector<std::unique_ptr<std::vector<double>>> states_;
  std::vector<std::unique_ptr<std::vector<double>>> removed_;
  ceres::Problem problem_;
  ProblemView view_;
};

void Grow(Chain* chain, int count) {
  for (int n = 0; n < count; ++n) {
    chain->AddState();
  }
}

TEST(WindowWatch, ASmallProblemIsExactUntilItHasLivedWithoutASlide) {
  Chain chain;
  WindowWatch watch;
  Grow(&chain, 3);
  for (int solve = 0; solve < WindowWatch::kQuietSolves; ++solve) {
    EXPECT_TRUE(chain.Look(&watch)) << solve;
    chain.AddState();
  }
  EXPECT_FALSE(chain.Look(&watch));
}

TEST(WindowWatch, AWindowThatSlidesStaysExact) {
  Chain chain;
  WindowWatch watch;
  Grow(&chain, 5);
  for (int solve = 0; solve < 4 * WindowWatch::kQuietSolves; ++solve) {
    EXPECT_TRUE(chain.Look(&watch)) << solve;
    chain.AddState();
    chain.RemoveFirst();
    chain.AddPrior(0);
  }
}

// The states of a window lie in an array, and the next one takes the place of the one removed.
TEST(WindowWatch, AWindowThatSlidesInPlaceStaysExact) {
  constexpr std::size_t kStates = 5;
  std::vector<std::vector<double>> places(kStates, std::vector<double>(6, 0.0));
  const auto place = [&places](int state) {
    return places[static_cast<std::size_t>(state) % kStates].data();
  };
  ceres::Problem problem;
  WindowWatch watch;
  ProblemView view;
  for (int newest = 1; newest < 4 * WindowWatch::kQuietSolves; ++newest) {
    if (newest >= static_cast<int>(kStates)) {
      problem.RemoveParameterBlock(place(newest));
      problem.AddResidualBlock(Nothing({6}), nullptr, place(newest + 1));
    }
    problem.AddResidualBlock(Nothing({6, 6}), nullptr, place(newest - 1), place(newest));
    Introspect(problem, &view);
    EXPECT_TRUE(watch.WantsExact(view)) << newest;
  }
}

// The newest state's only residual block is another one each time.
TEST(WindowWatch, AReplacedResidualBlockIsNoSlide) {
  ceres::Problem problem;
  std::vector<std::vector<double>> states(120, std::vector<double>(6));
  ceres::ResidualBlockId last = nullptr;
  for (std::size_t k = 0; k + 1 < states.size(); ++k) {
    last =
        problem.AddResidualBlock(Nothing({6, 6}), nullptr, states[k].data(), states[k + 1].data());
  }
  WindowWatch watch;
  ProblemView view;
  for (int solve = 0; solve < 3; ++solve) {
    Introspect(problem, &view);
    EXPECT_FALSE(watch.WantsExact(view)) << solve;
    problem.RemoveResidualBlock(last);
    last =
        problem.AddResidualBlock(Nothing({6, 6}), nullptr, states[118].data(), states[119].data());
  }
}

// Of the same cost functions each time: nothing has slid.
TEST(WindowWatch, AProblemThatIsBuiltAnewAndGrowsIsNotAWindowThatSlides) {
  std::vector<std::unique_ptr<ceres::CostFunction>> between;
  std::vector<std::unique_ptr<std::vector<double>>> states;
  states.push_back(std::make_unique<std::vector<double>>(6, 0.0));
  ceres::Problem::Options borrowing;
  borrowing.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  WindowWatch watch;
  ProblemView view;
  bool is_exact = true;
  for (int solve = 0; solve <= WindowWatch::kQuietSolves; ++solve) {
    states.push_back(std::make_unique<std::vector<double>>(6, 0.0));
    between.emplace_back(Nothing({6, 6}));
    ceres::Problem problem(borrowing);
    for (std::size_t k = 0; k < between.size(); ++k) {
      problem.AddResidualBlock(between[k].get(), nullptr, states[k]->data(), states[k + 1]->data());
    }
    Introspect(problem, &view);
    is_exact = watch.WantsExact(view);
  }
  EXPECT_FALSE(is_exact);
}

TEST(WindowWatch, ALargeProblemIsExactOnlyAfterASlide) {
  Chain chain;
  WindowWatch watch;
  Grow(&chain, 120);
  EXPECT_FALSE(chain.Look(&watch));
  chain.RemoveFirst();
  EXPECT_FALSE(chain.Look(&watch)) << "a state that goes without a prior is culled";
  chain.AddState();
  EXPECT_FALSE(chain.Look(&watch)) << "what comes touches a state that is new";
  chain.RemoveFirst();
  chain.AddPrior(0);
  for (int solve = 0; solve < WindowWatch::kQuietSolves; ++solve) {
    EXPECT_TRUE(chain.Look(&watch)) << solve;
  }
  EXPECT_FALSE(chain.Look(&watch));
}

TEST(WindowWatch, PointsComeAndGoWithoutASlide) {
  ceres::Problem problem;
  std::vector<std::vector<double>> cameras(120, std::vector<double>(6));
  std::vector<double> points(600);
  std::vector<ceres::ResidualBlockId> seen;
  const auto see = [&](std::size_t camera, std::size_t point) {
    seen.push_back(problem.AddResidualBlock(Nothing({6, 3}), nullptr, cameras[camera].data(),
                                            points.data() + 3 * point));
  };
  for (std::size_t c = 0; c < cameras.size(); ++c) {
    see(c, c);
    see(c, (c + 1) % cameras.size());
  }
  WindowWatch watch;
  ProblemView view;
  Introspect(problem, &view);
  EXPECT_FALSE(watch.WantsExact(view));
  problem.RemoveParameterBlock(points.data() + 3 * 7);
  see(20, 5);  // an old camera sees an old point
  Introspect(problem, &view);
  EXPECT_FALSE(watch.WantsExact(view));
}

UpdateSummary Work(int iterations, int relinearized, int evaluated) {
  UpdateSummary update;
  update.num_iterations = iterations;
  update.num_relinearized_factors = relinearized;
  update.num_evaluated_factors = evaluated;
  return update;
}

ProblemChanges Kept(int count) {
  ProblemChanges changes;
  changes.num_kept_factors = count;
  changes.num_added_factors = count / 50;
  return changes;
}

// Of this many residual blocks, of which so many touch a variable block.
ProblemView Sized(int all, int moving) {
  ProblemView view;
  view.all.num_residual_blocks = all;
  view.reduced.num_residual_blocks = moving;
  return view;
}

TEST(ModeChoice, StaysIncrementalWhereLittleIsTouched) {
  ModeChoice choice;
  for (int solve = 0; solve < 100; ++solve) {
    EXPECT_FALSE(choice.WantsExact());
    choice.Note(Work(4, 300, 2000), Kept(10000), Sized(10200, 10200), 100, true);
  }
}

TEST(ModeChoice, LosesPatienceAndTriesAgainLaterAndLater) {
  ModeChoice choice;
  std::vector<int> runs_of_exact;
  for (int trial = 0; trial < 3; ++trial) {
    for (int loss = 0; loss < ModeChoice::kLosses; ++loss) {
      ASSERT_FALSE(choice.WantsExact()) << trial;
      choice.Note(Work(4, 50000, 40000), Kept(10000), Sized(10200, 10200), 100, true);
    }
    int exact = 0;
    while (choice.WantsExact()) {
      ++exact;
    }
    runs_of_exact.push_back(exact);
    EXPECT_NE(choice.reason().find("times the work"), std::string::npos) << choice.reason();
    // The solve that WantsExact has just let be incremental counts as the first of the next trial.
    choice.Note(Work(4, 300, 2000), Kept(10000), Sized(10200, 10200), 100, true);
  }
  EXPECT_EQ(runs_of_exact,
            (std::vector<int>{ModeChoice::kPause, 2 * ModeChoice::kPause, 4 * ModeChoice::kPause}));
}

// An exact solve evaluates them once, whatever its iterations: the same work is little beside one
// of 14,000 residual blocks that move, and much beside one of 271.
TEST(ModeChoice, WhatTouchesConstantsOnlyIsNoWorkOfAnIteration) {
  ModeChoice choice, of_few;
  for (int solve = 0; solve < ModeChoice::kLosses; ++solve) {
    EXPECT_FALSE(choice.WantsExact());
    EXPECT_FALSE(of_few.WantsExact());
    choice.Note(Work(4, 300, 1500), Kept(14000), Sized(14280, 14280), 10, true);
    of_few.Note(Work(4, 300, 1500), Kept(14000), Sized(14280, 271), 10, true);
  }
  EXPECT_FALSE(choice.WantsExact());
  EXPECT_TRUE(of_few.WantsExact());
}

ceres::Solver::Summary ExactSolve(ceres::TerminationType termination, int iterations) {
  ceres::Solver::Summary summary;
  summary.termination_type = termination;
  summary.iterations.resize(iterations + 1);  // with iteration 0
  return summary;
}

TEST(ModeChoice, RemembersWhatExactSolvesFindSoon) {
  ModeChoice choice;
  EXPECT_FALSE(choice.IsToRemember());
  const ceres::Solver::Summary quick = ExactSolve(ceres::CONVERGENCE, ModeChoice::kPatience);
  for (const ceres::Solver::Summary& other :
       {ExactSolve(ceres::FAILURE, 5), ExactSolve(ceres::CONVERGENCE, ModeChoice::kPatience + 1),
        ExactSolve(ceres::NO_CONVERGENCE, 5)}) {
    choice.NoteExact(other, /*mostly_new=*/true);
    for (int solve = 0; solve < ModeChoice::kInARow; ++solve) {
      EXPECT_FALSE(choice.IsToRemember());
      choice.NoteExact(quick, /*mostly_new=*/true);
    }
    EXPECT_TRUE(choice.IsToRemember());
  }
}

// However long exact solves take.
TEST(ModeChoice, RemembersWhereLittleChangesBetweenSolves) {
  ModeChoice choice;
  const ceres::Solver::Summary slow = ExactSolve(ceres::NO_CONVERGENCE, 50);
  for (const ceres::TerminationType other : {ceres::FAILURE, ceres::CONVERGENCE}) {
    choice.NoteExact(ExactSolve(other, 50), /*mostly_new=*/other != ceres::FAILURE);
    for (int solve = 0; solve < ModeChoice::kInARow; ++solve) {
      EXPECT_FALSE(choice.IsToRemember());
      choice.NoteExact(slow, /*mostly_new=*/false);
    }
    EXPECT_TRUE(choice.IsToRemember());
  }
}

// After long exact solves the first incremental one decides.
TEST(ModeChoice, ALossAfterLongSolvesIsOneTooMany) {
  const auto lose = [](ModeChoice* choice) {
    choice->Note(Work(4, 50000, 40000), Kept(10000), Sized(10200, 10200), 100, true);
    return choice->WantsExact();
  };
  for (const ceres::Solver::Summary& last :
       {ExactSolve(ceres::NO_CONVERGENCE, ModeChoice::kPatience),
        ExactSolve(ceres::CONVERGENCE, ModeChoice::kPatience + 1)}) {
    ModeChoice choice;
    choice.NoteExact(last, /*mostly_new=*/false);
    EXPECT_TRUE(lose(&choice));
    ModeChoice after_win;
    after_win.NoteExact(last, /*mostly_new=*/false);
    after_win.Note(Work(4, 300, 2000), Kept(10000), Sized(10200, 10200), 100, true);
    EXPECT_FALSE(lose(&after_win));
  }
  ModeChoice choice;
  choice.NoteExact(ExactSolve(ceres::CONVERGENCE, ModeChoice::kPatience), /*mostly_new=*/false);
  EXPECT_FALSE(lose(&choice));
}

TEST(ModeChoice, ASolveWithNothingToRememberTeachesNothing) {
  ModeChoice choice;
  ProblemChanges anew;
  anew.num_added_factors = 10000;
  for (int solve = 0; solve < 10; ++solve) {
    choice.Note(Work(4, 90000, 40000), anew, Sized(10000, 10000), 100, true);
    EXPECT_FALSE(choice.WantsExact());
  }
}

}  // namespace
}  // namespace inceres::internal
