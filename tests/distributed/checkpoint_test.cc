// A solve that was ended goes on where it was, on any number of ranks; a file that is not whole is
// refused.
#include "distributed/checkpoint.h"

#include <algorithm>
#include <filesystem>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/distributed/distributed_solver.h"
#include "support/temp_dir.h"
#include "tests/distributed/parts.h"

namespace inceres::test {
namespace {

// A folder that all ranks know, made and removed by the first.
class SharedDir {
 public:
  SharedDir() {
    if (Rank() == 0) {
      own_.emplace();
      path_ = own_->path();
    }
    int size = static_cast<int>(path_.size());
    MPI_Bcast(&size, 1, MPI_INT, 0, MPI_COMM_WORLD);
    path_.resize(static_cast<std::size_t>(size));
    MPI_Bcast(path_.data(), size, MPI_CHAR, 0, MPI_COMM_WORLD);
  }
  ~SharedDir() { MPI_Barrier(MPI_COMM_WORLD); }
  std::string File(const std::string& name) const { return path_ + "/" + name; }

 private:
  std::optional<TempDir> own_;
  std::string path_;
};

DistributedOptions Options(TrustRegionStrategyKind strategy) {
  DistributedOptions options;
  options.solver = ExactOptions();
  options.solver.strategy = strategy;
  options.solver.function_tolerance = 1e-14;
  options.solver.max_num_iterations = 9;
  options.linear_solver = DistributedLinearSolver::kCholesky;
  return options;
}

void ExpectTail(const Summary& resumed, const Summary& whole, int from) {
  ASSERT_TRUE(resumed.IsSolutionUsable()) << resumed.message;
  ASSERT_FALSE(resumed.iterations.empty());
  EXPECT_EQ(resumed.iterations.front().iteration, from);
  EXPECT_EQ(resumed.termination, whole.termination);
  EXPECT_NEAR(resumed.initial_cost, whole.initial_cost, 1e-12 * whole.initial_cost);
  EXPECT_NEAR(resumed.final_cost, whole.final_cost, 1e-10 * whole.final_cost);
  EXPECT_EQ(resumed.num_successful_steps, whole.num_successful_steps);
  for (const IterationSummary& iteration : resumed.iterations) {
    ASSERT_LT(static_cast<std::size_t>(iteration.iteration), whole.iterations.size());
    const IterationSummary& before =
        whole.iterations[static_cast<std::size_t>(iteration.iteration)];
    EXPECT_NEAR(iteration.cost, before.cost, 1e-6 * before.cost);
    EXPECT_NEAR(iteration.trust_region_radius, before.trust_region_radius,
                1e-2 * before.trust_region_radius);
  }
}

TEST(Checkpoint, GoesOnWithTheSameTraceOnAnyNumberOfRanks) {
  for (const auto strategy :
       {TrustRegionStrategyKind::kLevenbergMarquardt, TrustRegionStrategyKind::kDogleg}) {
    const SharedDir dir;
    const auto anchored = [](int rank, int num_ranks) {
      auto part = std::make_unique<BalPart>(Street(), nullptr, -1, rank, num_ranks);
      if (num_ranks == NumRanks()) {
        part->Anchor(Street(), 2);
      } else {
        part->graph().SetConstant(part->cameras()[2], true);
        AnchorCameras(Street(), 2, part->cameras(), &part->graph());
      }
      return part;
    };
    DistributedOptions options = Options(strategy);
    const auto whole_part = anchored(Rank(), NumRanks());
    const Summary whole =
        DistributedSolver(MPI_COMM_WORLD, options).Solve(whole_part->part()).solve;
    ASSERT_GT(whole.iterations.size(), 4U);

    options.checkpoint.path = dir.File("state");
    options.checkpoint.every = 3;
    options.solver.callback = [](const IterationSummary& iteration, const double*) {
      return iteration.iteration == 3 ? ObserverAction::kAbort : ObserverAction::kContinue;
    };
    const auto ended_part = anchored(Rank(), NumRanks());
    const DistributedSummary ended =
        DistributedSolver(MPI_COMM_WORLD, options).Solve(ended_part->part());
    EXPECT_EQ(ended.solve.termination, Termination::kUserFailure);
    EXPECT_EQ(ended.num_checkpoints, 1) << ended.checkpoint_failure;
    EXPECT_FALSE(std::filesystem::exists(dir.File("state.partial")));

    options.solver.callback = nullptr;
    options.checkpoint.path.clear();
    options.checkpoint.resume = dir.File("state");
    const auto same = anchored(Rank(), NumRanks());
    ExpectTail(DistributedSolver(MPI_COMM_WORLD, options).Solve(same->part()).solve, whole, 3);
    const auto alone = anchored(0, 1);
    ExpectTail(DistributedSolver(MPI_COMM_SELF, options).Solve(alone->part()).solve, whole, 3);
  }
}

std::string WriteOne(const SharedDir& dir) {
  DistributedOptions options = Options(TrustRegionStrategyKind::kLevenbergMarquardt);
  options.solver.max_num_iterations = 2;
  options.checkpoint.path = dir.File("state");
  options.checkpoint.every = 1;
  BalPart part(Street());
  EXPECT_EQ(DistributedSolver(MPI_COMM_WORLD, options).Solve(part.part()).num_checkpoints, 2);
  return dir.File("state");
}

Summary ResumeFrom(const std::string& path, const GraphPart& part) {
  DistributedOptions options = Options(TrustRegionStrategyKind::kLevenbergMarquardt);
  options.checkpoint.resume = path;
  return DistributedSolver(MPI_COMM_WORLD, options).Solve(part).solve;
}

TEST(Checkpoint, WhatIsNotWholeIsRefusedAndNothingChanges) {
  const SharedDir dir;
  const std::string path = WriteOne(dir);
  const std::string bytes = ReadBytes(path);
  ASSERT_GT(bytes.size(), 1000U);
  const std::string other = dir.File("other");
  const auto expect_refused = [&](const std::string& content, const std::string& why) {
    MPI_Barrier(MPI_COMM_WORLD);
    if (Rank() == 0) {
      WriteBytes(other, content);
    }
    MPI_Barrier(MPI_COMM_WORLD);
    BalPart part(Street());
    const std::vector<double> before = part.graph().state();
    const Summary summary = ResumeFrom(other, part.part());
    EXPECT_EQ(summary.termination, Termination::kFailure);
    EXPECT_NE(summary.message.find(why), std::string::npos) << summary.message;
    EXPECT_EQ(part.graph().state(), before);
  };
  expect_refused(bytes.substr(0, bytes.size() - 1), "may have been cut");
  expect_refused(bytes.substr(0, 40), "too short");
  expect_refused("no " + bytes, "is no checkpoint");
  expect_refused(bytes + "x", "behind the last section");
  std::string flipped = bytes;
  flipped[flipped.size() - 20] = static_cast<char>(flipped[flipped.size() - 20] ^ 4);
  expect_refused(flipped, "the checksum of a section is wrong");
  flipped = bytes;
  flipped[50] = static_cast<char>(flipped[50] ^ 1);
  expect_refused(flipped, "checksum of its head");
  BalPart part(Street());
  EXPECT_NE(ResumeFrom(dir.File("nothing"), part.part()).message.find("cannot open"),
            std::string::npos);
}

TEST(Checkpoint, OfAnotherProblemIsRefused) {
  const SharedDir dir;
  const std::string path = WriteOne(dir);
  BalProblem fewer = Street();
  fewer.observations.erase(
      std::remove_if(fewer.observations.begin(), fewer.observations.end(),
                     [](const BalObservation& seen) { return seen.point == 7; }),
      fewer.observations.end());
  BalPart part(fewer);
  EXPECT_NE(ResumeFrom(path, part.part()).message.find("a checkpoint of 16 frames"),
            std::string::npos);
  BalPart renamed(Street());
  for (GlobalVariable& landmark : renamed.part().landmarks) {
    landmark.id += 1;
  }
  EXPECT_NE(ResumeFrom(path, renamed.part()).message.find("of another problem"), std::string::npos);
}

TEST(Checkpoint, ThatCannotBeWrittenIsToldAndTheSolveGoesOn) {
  DistributedOptions options = Options(TrustRegionStrategyKind::kLevenbergMarquardt);
  options.checkpoint.path = "/no/such/folder/state";
  options.checkpoint.every = 1;
  BalPart part(Street());
  const DistributedSummary summary = DistributedSolver(MPI_COMM_WORLD, options).Solve(part.part());
  EXPECT_TRUE(summary.solve.IsSolutionUsable());
  EXPECT_EQ(summary.num_checkpoints, 0);
  EXPECT_NE(summary.checkpoint_failure.find("rank 0: /no/such/folder/state.partial"),
            std::string::npos);
}

// By its id nobody could tell whose the record is.
TEST(Checkpoint, OfLandmarksWithoutIdsOfTheirOwnIsNotWritten) {
  const SharedDir dir;
  DistributedOptions options = Options(TrustRegionStrategyKind::kLevenbergMarquardt);
  options.solver.max_num_iterations = 2;
  options.checkpoint.path = dir.File("state");
  options.checkpoint.every = 1;
  const auto expect_told = [&](const BalPart& part, const std::string& why) {
    const DistributedSummary summary =
        DistributedSolver(MPI_COMM_WORLD, options).Solve(part.part());
    EXPECT_TRUE(summary.solve.IsSolutionUsable()) << summary.solve.message;
    EXPECT_EQ(summary.num_checkpoints, 0);
    EXPECT_NE(summary.checkpoint_failure.find(why), std::string::npos)
        << summary.checkpoint_failure;
    EXPECT_FALSE(std::filesystem::exists(options.checkpoint.path));
  };
  const bool last = Rank() == NumRanks() - 1;
  BalPart twice(Street());
  if (last) {
    twice.part().landmarks[1].id = twice.part().landmarks[0].id;
  }
  expect_told(twice, "GraphPart::landmarks has two of id ");
  BalPart negative(Street());
  if (last) {
    negative.part().landmarks[0].id = -7;
  }
  expect_told(negative, "rank " + std::to_string(NumRanks() - 1) + ": landmark variable ");
  if (NumRanks() > 1) {
    BalPart shared(Street());
    shared.part().landmarks[0].id = 5000;
    expect_told(shared, "has two of id 5000, on rank 0 and rank 1");
  }
}

// With sums that are right, so that what is behind them is reached.
TEST(Checkpoint, MutatedFilesAreRefusedOrReadNeverMore) {
  if (Rank() != 0) {
    return;
  }
  internal::CheckpointHead head;
  head.position.num_successful_steps = 1;
  head.position.strategy = {1e4, 2.0, 10.0, 0.0};
  std::vector<char> section;
  const double numbers[9] = {1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0};
  for (int i = 0; i < 20; ++i) {
    internal::CheckpointRecord record;
    record.id = i;
    record.ambient_size = 9;
    record.tangent_size = 9;
    AppendRecord(record, numbers, numbers, &section);
  }
  const TempDir dir;
  std::mt19937_64 random(7);
  int num_refused = 0;
  for (int trial = 0; trial < 600; ++trial) {
    std::vector<char> mutated = section;
    for (std::uint64_t k = random() % 4; k > 0; --k) {
      mutated[random() % mutated.size()] = static_cast<char>(random());
    }
    if (random() % 8 == 0) {
      mutated.resize(random() % mutated.size());
    }
    std::vector<internal::CheckpointSection> sections(1);
    sections[0].bytes = static_cast<std::int64_t>(mutated.size());
    sections[0].checksum = internal::ChecksumOf(mutated.data(), mutated.size());
    std::vector<char> bytes = EncodeHead(head, &sections);
    bytes.insert(bytes.end(), mutated.begin(), mutated.end());
    if (trial % 2 == 1) {  // of the head, whose sum is then wrong
      bytes[random() % bytes.size()] = static_cast<char>(random());
    }
    WriteBytes(dir.File("mutated"), std::string(bytes.begin(), bytes.end()));
    internal::CheckpointReader reader;
    Status status = reader.Open(dir.File("mutated"));
    double sum = 0.0;
    if (status.ok()) {
      status = reader.ForEach(
          [&](const internal::CheckpointRecord& record, const double* values, const double* scale) {
            sum += values[record.ambient_size - 1] + scale[record.tangent_size - 1];
            return true;
          });
    }
    EXPECT_EQ(status.ok(), status.message.empty());
    num_refused += status.ok() ? 0 : 1;
  }
  EXPECT_GT(num_refused, 150);
}

}  // namespace
}  // namespace inceres::test
