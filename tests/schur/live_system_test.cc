// The law of the incremental Schur complement: whatever was added, moved, relinearised or damped anew, in whatever order, S and b
// are those of a rebuild from the same cached Jacobians, weights and landmark damping.

#include "schur/live_system.h"

#include <cmath>
#include <memory>
#include <vector>

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "inceres/graph/losses.h"
#include "inceres/graph/manifolds.h"
#include "support/random_graph.h"

namespace inceres::internal {
namespace {

// What the graph has gained since the last call becomes part of the system.
class Follower {
 public:
  void TakeUp(const FactorGraph& graph, LiveSystem* system) {
    for (; num_variables_ < graph.num_variables(); ++num_variables_) {
      system->AddVariable(num_variables_);
    }
    num_factors_.resize(graph.num_families(), 0);
    for (FamilyId family = 0; family < graph.num_families(); ++family) {
      for (int& i = num_factors_[family]; i < graph.NumFactors(family); ++i) {
        system->AddFactor({family, i});
      }
    }
  }

 private:
  int num_variables_ = 0;
  std::vector<int> num_factors_;
};

using test::Random;
using test::RandomGraph;

// H and the right-hand side, frames first, then landmarks, from the caches of a live system; and S and b by dense algebra.
class Rebuild {
 public:
  explicit Rebuild(const LiveSystem& system) : schur_(system.schur()) {
    for (const LiveSchur::Landmark& landmark : schur_.landmarks()) {
      landmark_offsets_.push_back(size_of_frames() + num_landmark_entries_);
      num_landmark_entries_ += landmark.size;
    }
    H_ = Eigen::MatrixXd::Zero(size(), size());
    rhs_ = Eigen::VectorXd::Zero(size());
    for (const LiveFamily& family : system.families()) {
      for (int i = 0; i < family.num_places(); ++i) {
        AddFactor(family, i);
      }
    }
    C_diagonal_ = H_.diagonal().head(size_of_frames());
    Eliminate();
  }

  void ExpectEqual() const {
    const SymmetricBlockRows& S = schur_.S();
    for (int row = 0; row < S.num_rows(); ++row) {
      for (int column = 0; column <= row; ++column) {
        const std::int64_t offset = S.Find(row, column);
        for (int r = 0; r < S.size_of(row); ++r) {
          for (int c = 0; c < S.size_of(column); ++c) {
            const int i = schur_.FrameOffset(row) + r;
            const int j = schur_.FrameOffset(column) + c;
            const double value = offset < 0 ? 0.0 : S.values(offset)[r * PadToQuad(S.size_of(column)) + c];
            ASSERT_LE(std::fabs(value - H_(i, j)), 1e-10 * std::sqrt(C_diagonal_[i] * C_diagonal_[j]))
                << "S(" << i << ", " << j << ")";
          }
        }
      }
    }
    for (int i = 0; i < size_of_frames(); ++i) {
      ASSERT_LE(std::fabs(b(i) - rhs_[i]), 1e-10 * std::sqrt(C_diagonal_[i] * (1.0 + squared_q_))) << "b(" << i << ")";
      ASSERT_NEAR(schur_.FrameDiagonal()[i], C_diagonal_[i], 1e-10 * C_diagonal_[i]);
    }
  }

 private:
  int size_of_frames() const { return static_cast<int>(schur_.size()); }
  int size() const { return size_of_frames() + num_landmark_entries_; }

  // Entry i of the packed b.
  double b(int i) const {
    int frame = 0;
    while (schur_.FrameOffset(frame + 1) <= i) {
      ++frame;
    }
    return schur_.b(frame)[i - schur_.FrameOffset(frame)];
  }

  void AddFactor(const LiveFamily& family, int i) {
    const FactorRef ref{family.id(), i};
    Eigen::MatrixXd J = Eigen::MatrixXd::Zero(family.residual_size(), size());
    for (int s = 0; s < family.num_slots(); ++s) {
      const std::int32_t frame = schur_.FrameOfFactor(ref, s);
      const std::int32_t landmark = schur_.LandmarkOfFactor(ref);
      int offset = -1;
      if (frame >= 0) {
        offset = schur_.FrameOffset(frame);
      } else if (landmark >= 0 && schur_.landmarks()[landmark].id == family.variables(i)[s]) {
        offset = landmark_offsets_[landmark];
      } else {
        continue;
      }
      const SlotJacobians& slot = family.slots()[s];
      for (int r = 0; r < family.residual_size(); ++r) {
        for (int c = 0; c < slot.columns; ++c) {
          J(r, offset + c) = family.Jacobian(i, s)[r * slot.row_stride + c];
        }
      }
    }
    const Eigen::Map<const Eigen::VectorXd> q(family.q(i), family.residual_size());
    H_ += J.transpose() * J;
    rhs_ -= J.transpose() * q;
    squared_q_ += q.squaredNorm();
  }

  void Eliminate() {
    for (std::size_t l = 0; l < landmark_offsets_.size(); ++l) {
      const LiveSchur::Landmark& landmark = schur_.landmarks()[l];
      const int at = landmark_offsets_[l];
      const int d = landmark.size;
      Eigen::MatrixXd P = H_.block(at, at, d, d);
      ASSERT_EQ(landmark.in_S, P.diagonal().maxCoeff() > 0.0);
      if (!landmark.in_S) {
        continue;
      }
      P.diagonal() *= 1.0 + landmark.lambda;
      const Eigen::MatrixXd W = H_.block(0, at, size_of_frames(), d);
      const Eigen::MatrixXd W_P_inv = P.llt().solve(W.transpose()).transpose();
      H_.topLeftCorner(size_of_frames(), size_of_frames()) -= W_P_inv * W.transpose();
      rhs_.head(size_of_frames()) -= W_P_inv * rhs_.segment(at, d);
    }
  }

  const LiveSchur& schur_;
  std::vector<int> landmark_offsets_;
  int num_landmark_entries_ = 0;
  Eigen::MatrixXd H_;
  Eigen::VectorXd rhs_;
  Eigen::VectorXd C_diagonal_;
  double squared_q_ = 0.0;
};

// Grows a random problem and does random things to the live system that follows it.
class Sequence {
 public:
  explicit Sequence(unsigned seed) : graph_(seed), random_(seed + 1000), system_(graph_.graph(), 1) {
    for (int i = 0; i < 3; ++i) {
      AddFrame();
    }
  }

  void Grow() {
    if (random_.Below(3) == 0) {
      AddFrame();
    }
    const VariableId landmark = random_.Below(4) == 0 ? graph_.AddLandmark(std::make_shared<SphereManifold>(4))
                                                      : graph_.AddLandmark(1 + random_.Below(4));
    landmarks_.push_back(landmark);
    Observe(landmark);
    Observe(landmarks_[random_.Below(static_cast<int>(landmarks_.size()))]);
  }

  void Relinearise() {
    follower_.TakeUp(graph_.graph(), &system_);
    RelineariseWork work;
    const RebuildRule rules[] = {RebuildRule::kWhenCheaper, RebuildRule::kAlways, RebuildRule::kNever};
    const Status status = system_.Relinearise(std::pow(10.0, random_.Between(-9.0, 1.0)), rules[random_.Below(3)], &work);
    ASSERT_TRUE(status.ok()) << status.message;
  }

  void MarkSome() {
    for (const LiveFamily& family : system_.families()) {
      for (int i = 0; i < family.num_places(); ++i) {
        if (random_.Below(5) == 0) {
          system_.MarkDirty({family.id(), i});
        }
      }
    }
    const int num_landmarks = static_cast<int>(system_.schur().landmarks().size());
    if (num_landmarks > 0) {
      system_.Redamp(random_.Below(num_landmarks));
    }
  }

  // Any step is legal, not only the solution of the system.
  void Step() {
    for (int i = 0; i < static_cast<int>(system_.schur().frames().size()); ++i) {
      if (random_.Below(2) == 0) {
        std::vector<double> step = random_.Vector(system_.schur().frames()[i].size);
        for (double& entry : step) {
          entry *= 1e-2;
        }
        system_.SetFrameStep(i, step.data());
      }
    }
    for (int l = 0; l < static_cast<int>(system_.schur().landmarks().size()); ++l) {
      if (random_.Below(2) == 0) {
        system_.Visit(l);
      }
    }
    double change = 0.0;
    double predicted = 0.0;
    const double before = system_.cost();
    ASSERT_TRUE(system_.EvaluateStep(&change, &predicted).ok());
    if (random_.Below(4) == 0) {
      system_.Reject();
      EXPECT_EQ(system_.cost(), before);
    } else {
      system_.Accept();
      EXPECT_NEAR(system_.cost(), before + change, 1e-12 * (before + std::fabs(change)));
    }
  }

  const LiveSystem& system() const { return system_; }

 private:
  void AddFrame() {
    const int kind = random_.Below(4);
    frames_.push_back(kind == 0   ? graph_.AddFrame(std::make_shared<PoseManifold>())
                      : kind == 1 ? graph_.AddFrame(9)
                                  : graph_.AddFrame(1 + random_.Below(7)));
    graph_.Connect(graph_.graph().TangentSize(frames_.back()), {frames_.back()});
    if (frames_.size() > 1) {
      graph_.Connect(3, {frames_[frames_.size() - 2], frames_.back()});
    }
  }

  void Observe(VariableId landmark) {
    std::shared_ptr<const Loss> loss;
    if (random_.Below(2) == 0) {
      loss = std::make_shared<HuberLoss>(0.5);
    }
    const VariableId frame = frames_[random_.Below(static_cast<int>(frames_.size()))];
    const VariableId other = frames_[random_.Below(static_cast<int>(frames_.size()))];
    graph_.Connect(4, {frame, landmark}, loss);
    if (other != frame) {
      graph_.Connect(2, {frame, other, landmark}, loss);
    }
  }

  RandomGraph graph_;
  Random random_;
  LiveSystem system_;
  Follower follower_;
  std::vector<VariableId> frames_;
  std::vector<VariableId> landmarks_;
};

class LiveSystemLaw : public testing::TestWithParam<unsigned> {};

TEST_P(LiveSystemLaw, SAndBAreThoseOfARebuild) {
  Sequence sequence(GetParam());
  for (int round = 0; round < 25; ++round) {
    sequence.Grow();
    sequence.Relinearise();
    ASSERT_NO_FATAL_FAILURE(Rebuild(sequence.system()).ExpectEqual()) << "grown, round " << round;
    sequence.Step();
    ASSERT_NO_FATAL_FAILURE(Rebuild(sequence.system()).ExpectEqual()) << "moved, round " << round;
    sequence.MarkSome();
    sequence.Relinearise();
    ASSERT_NO_FATAL_FAILURE(Rebuild(sequence.system()).ExpectEqual()) << "relinearised, round " << round;
  }
}

INSTANTIATE_TEST_SUITE_P(Seeds, LiveSystemLaw, testing::Range(0U, 20U));

// What the old linearisation predicts, f̂, is exact for a step no factor curves under: the error it is kept for is then zero.
TEST(LiveSystem, TheErrorOfALinearisationIsThatOfItsPrediction) {
  RandomGraph graph(3);
  const VariableId frame = graph.AddFrame(3);
  graph.Connect(4, {frame}, std::make_shared<HuberLoss>(0.1));
  LiveSystem system(graph.graph(), 1);
  Follower().TakeUp(graph.graph(), &system);
  RelineariseWork work;
  ASSERT_TRUE(system.Relinearise(0.0, RebuildRule::kNever, &work).ok());
  const LiveFamily& family = system.families()[0];
  EXPECT_EQ(family.SquaredError(0), 0.0);
  double errors[2] = {0.0, 0.0};
  for (const int halvings : {0, 1}) {
    const double size = halvings == 0 ? 1e-2 : 5e-3;
    const double step[3] = {size, -size, size};
    system.SetFrameStep(0, step);
    double change = 0.0;
    double predicted = 0.0;
    ASSERT_TRUE(system.EvaluateStep(&change, &predicted).ok());
    system.Accept();
    errors[halvings] = std::sqrt(family.SquaredError(0));
    system.MarkDirty({0, 0});
    ASSERT_TRUE(system.Relinearise(0.0, RebuildRule::kNever, &work).ok());
  }
  EXPECT_NEAR(errors[0] / errors[1], 4.0, 0.5) << "the error is of second order in the step";
}

}  // namespace
}  // namespace inceres::internal
