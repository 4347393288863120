// docs/ceres_contract.md, "Twelve behaviors of estimators", 1 to 4 and 8: whose values, whose
// memory, whose contents.
#include <cmath>
#include <cstdlib>
#include <cstring>

#include "conformance/support.h"

namespace conformance {
namespace {

ceres::Problem::Options Borrowing() {
  ceres::Problem::Options options;
  options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  return options;
}

Options Tight(ceres::LinearSolverType type = ceres::DENSE_SCHUR) {
  Options options;
  options.linear_solver_type = type;
  options.function_tolerance = 1e-14;
  return options;
}

// r = b − a − d.
Cost* Difference(double d) {
  return new Cost(1, {1, 1}, [=](double const* const* p, double* residuals, double** jacobians) {
    residuals[0] = p[1][0] - p[0][0] - d;
    if (jacobians != nullptr) {
      for (int k = 0; k < 2; ++k) {
        if (jacobians[k] != nullptr) {
          jacobians[k][0] = k == 0 ? -1.0 : 1.0;
        }
      }
    }
    return true;
  });
}

TEST(TwelveBehaviors, b01_values_are_read_at_solve_time) {
  Line line;
  line.x[0] = 7.0;  // after AddResidualBlock
  EXPECT_EQ(Solve(Tight(), &line.problem).summary.initial_cost, 4.5);
  EXPECT_NEAR(line.x[0], 10.0, 1e-6);
  for (const double value : {-20.0, 4.0, 4.0}) {  // between the solves of a problem that lives on
    line.x[0] = value;
    ExpectClose(Solve(Tight(), &line.problem).summary.initial_cost,
                0.5 * (10.0 - value) * (10.0 - value));
    EXPECT_NEAR(line.x[0], 10.0, 1e-5);
  }
}

// VINS: slots of fixed memory serve another frame, another landmark each time; a new Problem and
// new cost functions, at addresses that malloc hands out again.
TEST(TwelveBehaviors, b02_pointer_identity_is_not_variable_identity) {
  double pose[5] = {};
  double feature[20] = {};
  for (int frame = 0; frame < 30; ++frame) {
    ceres::Problem problem;
    for (int i = 0; i < 5; ++i) {
      problem.AddParameterBlock(&pose[i], 1);
    }
    for (int i = 0; i < 5; ++i) {  // shifted by one slot, the newest predicted badly
      pose[i] = i < 4 ? pose[i + 1] : 0.0;
      problem.AddResidualBlock(Target({frame + i - 1.0}), nullptr, &pose[i]);
      problem.AddResidualBlock(Target({frame + i + 1.0}), nullptr, &pose[i]);
    }
    const int num_features = 5 + frame % 15;
    for (int k = 0; k < num_features; ++k) {
      feature[k] = 0.0;
      for (int i = 0; i < 5; ++i) {
        problem.AddResidualBlock(Difference(k - i + (i % 2 == 0 ? 0.5 : -0.75)), nullptr, &pose[i],
                                 &feature[k]);
      }
    }
    const Summary summary = Solve(Tight(), &problem).summary;
    // 5 poses with ±1, features that see ±½ three times and ±¾ twice: the mean of the differences
    // is 0.
    EXPECT_TRUE(summary.IsSolutionUsable());
    const double shift = num_features / (num_features + 2.0);
    for (int i = 0; i < 5; ++i) {
      EXPECT_NEAR(pose[i], frame + i + (i % 2 == 0 ? -0.5 : 0.75) * shift, 1e-5)
          << "frame " << frame;
    }
    for (int k = 0; k < num_features; ++k) {
      EXPECT_NEAR(feature[k], frame + k, 1e-5) << "frame " << frame;
    }
  }
}

// The same in one Problem that lives on: the memory comes back as a block of another size.
TEST(TwelveBehaviors, b02_the_same_memory_as_another_variable) {
  ceres::Problem problem;
  double memory[3] = {};
  for (int frame = 0; frame < 9; ++frame) {
    const int size = 1 + frame % 3;
    std::vector<double> target;
    for (int k = 0; k < size; ++k) {
      memory[k] = -1.0;
      target.push_back(frame + k);
    }
    problem.AddResidualBlock(Target(target), nullptr, memory);
    problem.AddResidualBlock(Target(std::vector<double>(target.size(), 0.0)), nullptr, memory);
    EXPECT_EQ(Solve(Tight(), &problem).summary.num_parameters, size);
    for (int k = 0; k < size; ++k) {
      EXPECT_NEAR(memory[k], 0.5 * (frame + k), 1e-5) << "frame " << frame;
    }
    problem.RemoveParameterBlock(memory);
  }
}

// VINS moves the whole window after each solve, back to where its first pose was: every bit
// changes, no cost does.
TEST(TwelveBehaviors, b03_every_pose_changes_bitwise_each_frame) {
  World world;
  std::vector<double*> poses;
  for (int i = 0; i < 8; ++i) {
    poses.push_back(world.Add({0.3 * i}));
    if (i > 0) {
      world.problem.AddResidualBlock(Difference(1.0), nullptr, poses[poses.size() - 2],
                                     poses.back());
    }
    if (i > 1) {
      world.problem.AddResidualBlock(Difference(2.3), nullptr, poses[poses.size() - 3],
                                     poses.back());
    }
  }
  double cost = -1.0;
  for (int frame = 0; frame < 12; ++frame) {
    const Summary summary = Solve(Tight(), &world.problem).summary;
    ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
    ExpectClose(summary.final_cost, 0.0589655172413793, 1e-6);
    if (cost >= 0.0) {
      EXPECT_NEAR(summary.initial_cost, cost, 1e-9);
    }
    cost = summary.final_cost;
    const double shift = frame % 3 == 0 ? 1e-13 : -poses[0][0] + 0.1 * frame;
    for (double* pose : poses) {
      pose[0] = frame % 3 == 2 ? std::nextafter(pose[0], 100.0) : pose[0] + shift;
    }
  }
}

// OKVIS's marginalization error: sizes, residual count and contents change between Remove and Add
// of one object.
class Marginalization : public ceres::CostFunction {
 public:
  void Become(std::vector<double> targets, double weight) {
    targets_ = std::move(targets);
    weight_ = weight;
    set_num_residuals(static_cast<int>(targets_.size()));
    mutable_parameter_block_sizes()->assign(targets_.size(), 1);
  }
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const std::size_t size = targets_.size();
    for (std::size_t k = 0; k < size; ++k) {
      residuals[k] = weight_ * (parameters[k][0] - targets_[k]);
      if (jacobians != nullptr && jacobians[k] != nullptr) {
        std::fill_n(jacobians[k], size, 0.0);
        jacobians[k][k] = weight_;
      }
    }
    return true;
  }

 private:
  std::vector<double> targets_;
  double weight_ = 1.0;
};

TEST(TwelveBehaviors, b04_same_cost_function_with_new_contents) {
  std::deque<Marginalization> pulls(4);
  Marginalization prior;
  double x[4] = {};
  ceres::Problem problem(Borrowing());
  for (int k = 0; k < 4; ++k) {
    pulls[static_cast<std::size_t>(k)].Become({1.0 + k}, 1.0);
    problem.AddResidualBlock(&pulls[static_cast<std::size_t>(k)], nullptr, &x[k]);
  }
  for (int frame = 0; frame < 12; ++frame) {
    const int size = 1 + frame % 4;
    const double target = 0.25 * frame;
    const double weight = frame % 2 == 0 ? 1.0 : 2.0;
    prior.Become(std::vector<double>(static_cast<std::size_t>(size), target), weight);
    std::vector<double*> blocks;
    for (int k = 0; k < size; ++k) {
      blocks.push_back(&x[k]);
    }
    const ceres::ResidualBlockId id = problem.AddResidualBlock(&prior, nullptr, blocks);
    EXPECT_TRUE(Solve(Tight(), &problem).summary.IsSolutionUsable());
    for (int k = 0; k < 4; ++k) {
      const double w2 = k < size ? weight * weight : 0.0;
      EXPECT_NEAR(x[k], (1.0 + k + w2 * target) / (1.0 + w2), 1e-5)
          << "frame " << frame << ", block " << k;
    }
    problem.RemoveResidualBlock(id);
  }
}

// What VINS's marginalization factor points to is deleted after Solve, while Problem and factor
// live on.
struct MarginalizationInfo {
  std::vector<double> targets = {1.0, 2.0};
};

TEST(TwelveBehaviors, b08_no_evaluation_after_solve_returns) {
  std::vector<std::unique_ptr<ceres::Problem>> alive;
  std::vector<std::unique_ptr<std::vector<double>>> memory;
  for (int frame = 0; frame < 5; ++frame) {
    auto info = std::make_unique<MarginalizationInfo>();
    MarginalizationInfo* borrowed = info.get();
    auto solving = std::make_shared<bool>(true);
    memory.push_back(std::make_unique<std::vector<double>>(2, 0.0));
    double* x = memory.back()->data();
    alive.push_back(std::make_unique<ceres::Problem>());
    auto* factor =
        new Cost(2, {2}, [=](double const* const* p, double* residuals, double** jacobians) {
          if (!*solving) {
            std::abort();  // its numbers are gone
          }
          for (std::size_t k = 0; k < 2; ++k) {
            residuals[k] = p[0][k] - borrowed->targets[k];
          }
          if (jacobians != nullptr && jacobians[0] != nullptr) {
            const double identity[4] = {1.0, 0.0, 0.0, 1.0};
            std::memcpy(jacobians[0], identity, sizeof(identity));
          }
          return true;
        });
    alive.back()->AddResidualBlock(factor, nullptr, x);
    EXPECT_TRUE(Solve(Tight(), alive.back().get()).summary.IsSolutionUsable());
    *solving = false;
    info.reset();
    EXPECT_NEAR(x[1], 2.0, 1e-6);
    memory.back()->assign(2, 5.0);
    if (frame > 1) {
      alive.erase(
          alive.begin());  // the Problem of two frames ago goes; its blocks' memory is still there
    }
  }
  alive.clear();
  EXPECT_EQ(memory[4]->at(0), 5.0) << "nothing is written after Solve has returned";
}

}  // namespace
}  // namespace conformance
