#include "linearize/incidences.h"

#include <algorithm>
#include <cstdint>
#include <set>
#include <tuple>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "support/core_pipeline.h"
#include "support/random_graph.h"

namespace inceres::internal {
namespace {

using test::BundleOptions;
using test::CorePipeline;
using test::MakeBundle;
using test::RandomGraph;

struct Case {
  unsigned seed;
  std::int64_t quads_per_chunk = LandmarkIncidences::kQuadsPerChunk;
  std::vector<int> frame_sizes = {6, 9, 15, 3, 1};
};

// Hosts, losses and constants; landmarks of sizes 1 to 4.
BundleOptions MixedBundle(const Case& a_case) {
  const unsigned seed = a_case.seed;
  BundleOptions options;
  options.seed = seed;
  options.num_frames = 9;
  options.num_landmarks = 40;
  options.frame_sizes = a_case.frame_sizes;
  options.landmark_sizes = {3, 1, 4, 2};
  options.residual_sizes = {2, 3, 1};
  options.hosted = seed % 2 == 1;
  options.constants = true;
  return options;
}

// (landmark, frame) pairs that share a factor, by looking at every factor.
std::set<std::pair<int, int>> SharedPairs(const FactorGraph& graph, const Layout& layout) {
  std::set<std::pair<int, int>> pairs;
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    const int num_slots = graph.family(id).num_slots();
    for (int i = 0; i < graph.NumFactors(id); ++i) {
      const VariableId* ids = graph.Variables(id, i);
      for (int a = 0; a < num_slots; ++a) {
        for (int b = 0; b < num_slots; ++b) {
          if (layout.LandmarkOf(ids[a]) >= 0 && layout.FrameOf(ids[b]) >= 0) {
            pairs.emplace(layout.LandmarkOf(ids[a]), layout.FrameOf(ids[b]));
          }
        }
      }
    }
  }
  return pairs;
}

class Incidences : public testing::TestWithParam<Case> {
 protected:
  Incidences()
      : bundle_(MakeBundle(MixedBundle(GetParam()))),
        core_(bundle_->graph(), true, 1, GetParam().quads_per_chunk) {}

  std::int64_t QuadsOf(int incidence) const {
    const LandmarkIncidences& all = core_.incidences;
    const int frame_size =
        core_.layout.TangentSize(all.frames[static_cast<std::size_t>(incidence)]);
    const int depth =
        all.sizes[static_cast<std::size_t>(all.landmarks[static_cast<std::size_t>(incidence)])];
    return all.tail ? QuadsWithTail(depth, frame_size) : depth * PadToQuad(frame_size) / kQuad;
  }

  std::unique_ptr<RandomGraph> bundle_;
  CorePipeline core_;
};

TEST_P(Incidences, OnePerLandmarkAndFrameThatShareAFactor) {
  const LandmarkIncidences& all = core_.incidences;
  std::set<std::pair<int, int>> found;
  for (int l = 0; l < all.num_landmarks(); ++l) {
    for (int q = all.begin[static_cast<std::size_t>(l)];
         q < all.begin[static_cast<std::size_t>(l) + 1]; ++q) {
      EXPECT_EQ(all.landmarks[static_cast<std::size_t>(q)], l);
      EXPECT_TRUE(found.emplace(l, all.frames[static_cast<std::size_t>(q)]).second)
          << "twice the same frame";
    }
  }
  EXPECT_EQ(found, SharedPairs(bundle_->graph(), core_.layout));
}

TEST_P(Incidences, ChunksAreAsLongAsTheirYAllows) {
  const LandmarkIncidences& all = core_.incidences;
  const auto quads_of = [&](int landmark) {
    std::int64_t quads = 0;
    for (int q = all.begin[static_cast<std::size_t>(landmark)];
         q < all.begin[static_cast<std::size_t>(landmark) + 1]; ++q) {
      quads += QuadsOf(q);
    }
    return quads;
  };
  EXPECT_EQ(all.chunk_begin.front(), 0);
  EXPECT_EQ(all.chunk_begin.back(), all.num_landmarks());
  std::int64_t largest = 0;
  for (std::size_t chunk = 0; chunk + 1 < all.chunk_begin.size(); ++chunk) {
    const int end = all.chunk_begin[chunk + 1];
    ASSERT_LT(all.chunk_begin[chunk], end);
    std::int64_t quads = 0;
    for (int l = all.chunk_begin[chunk]; l < end; ++l) {
      EXPECT_EQ(all.ChunkOf(l), static_cast<int>(chunk));
      quads += quads_of(l);
    }
    EXPECT_TRUE(quads <= GetParam().quads_per_chunk || end == all.chunk_begin[chunk] + 1);
    if (end < all.num_landmarks()) {
      EXPECT_GT(quads + quads_of(end), GetParam().quads_per_chunk)
          << "the next landmark would have fitted";
    }
    largest = std::max(largest, quads);
  }
  EXPECT_EQ(all.y_quads, largest);
  EXPECT_EQ(all.num_chunks() > 1, GetParam().quads_per_chunk < LandmarkIncidences::kQuadsPerChunk);
}

TEST_P(Incidences, BlocksOfYLieSideBySideByFrameAndNeverOverlap) {
  const LandmarkIncidences& all = core_.incidences;
  ASSERT_EQ(all.frame_incidences.size(), all.incidences.size());
  std::vector<std::int64_t> next(static_cast<std::size_t>(all.num_chunks()), 0);
  for (int frame = 0; frame < core_.layout.num_frames; ++frame) {
    std::tuple<int, int, int> last{0, 0, -1};
    const auto f = static_cast<std::size_t>(frame);
    for (int k = all.frame_begin[f]; k < all.frame_begin[f + 1]; ++k) {
      const auto q = static_cast<std::size_t>(all.frame_incidences[static_cast<std::size_t>(k)]);
      const int landmark = all.landmarks[q];
      const int size = all.sizes[static_cast<std::size_t>(landmark)];
      EXPECT_EQ(all.frames[q], frame);
      const int chunk = all.ChunkOf(landmark);
      EXPECT_LT(last, std::make_tuple(chunk, size, landmark))
          << "not sorted by chunk, then landmark size, then landmark";
      last = {chunk, size, landmark};
      std::int64_t& place = next[static_cast<std::size_t>(chunk)];
      EXPECT_EQ(all.incidences[q].y, place);
      EXPECT_EQ(all.incidences[q].frame, core_.layout.quad_offset[f]);
      EXPECT_EQ(all.incidences[q].quads, PadToQuad(core_.layout.TangentSize(frame)) / kQuad);
      place += QuadsOf(static_cast<int>(q));
    }
  }
  EXPECT_EQ(*std::max_element(next.begin(), next.end()), all.y_quads);
}

// Walks the factors as the elimination does: the first that reaches a block begins it, later ones
// add to it.
TEST_P(Incidences, TargetsBeginEachBlockOnceAndCoverEveryFactor) {
  const LandmarkIncidences& all = core_.incidences;
  const FactorGraph& graph = bundle_->graph();
  int num_factors = 0;
  for (int l = 0; l < all.num_landmarks(); ++l) {
    std::set<std::int32_t> begun;
    for (int k = all.factors_begin[static_cast<std::size_t>(l)];
         k < all.factors_begin[static_cast<std::size_t>(l) + 1]; ++k) {
      const LandmarkFactors& entry = all.factors[static_cast<std::size_t>(k)];
      const auto& families = core_.evaluator.families();
      const auto owner = std::find_if(
          families.begin(), families.end(),
          [&](const Linearization& cache) { return cache.slots.data() == entry.jacobians; });
      ASSERT_NE(owner, families.end());
      EXPECT_EQ(entry.residual_size, owner->family->residual_size());
      EXPECT_EQ(entry.residuals, owner->residuals.data());
      for (int n = 0; n < entry.count; ++n, ++num_factors) {
        const VariableId* ids = graph.Variables(owner->id, entry.factors[n]);
        EXPECT_EQ(core_.layout.LandmarkOf(ids[entry.landmark_slot]), l);
        for (int s = 0; s < entry.num_slots; ++s) {
          const std::int32_t target = entry.y_targets[entry.factors[n] * entry.num_slots + s];
          ASSERT_EQ(target >= 0, core_.layout.FrameOf(ids[s]) >= 0);
          if (target >= 0) {
            EXPECT_EQ((target & 1) == 0, begun.insert(target >> 1).second);
          }
        }
      }
    }
    EXPECT_EQ(begun.size(), static_cast<std::size_t>(all.begin[static_cast<std::size_t>(l) + 1] -
                                                     all.begin[static_cast<std::size_t>(l)]));
  }
  int expected = 0;
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    for (int i = 0; i < graph.NumFactors(id); ++i) {
      const VariableId* ids = graph.Variables(id, i);
      expected += std::any_of(ids, ids + graph.family(id).num_slots(), [&](VariableId variable) {
        return core_.layout.LandmarkOf(variable) >= 0;
      });
    }
  }
  EXPECT_EQ(num_factors, expected);
}

TEST_P(Incidences, LastColumnsAreApartWhereAllFramesAreOfASizeThatSavesThePadding) {
  const std::vector<int>& sizes = GetParam().frame_sizes;
  EXPECT_EQ(core_.incidences.tail, sizes == std::vector<int>{9} || sizes == std::vector<int>{13});
}

INSTANTIATE_TEST_SUITE_P(Seeds, Incidences,
                         testing::Values(Case{1}, Case{2}, Case{3}, Case{4}, Case{1, 1},
                                         Case{2, 90}, Case{3, 300}, Case{1, 80, {9}},
                                         Case{2, LandmarkIncidences::kQuadsPerChunk, {13}},
                                         Case{3, 80, {7}}, Case{4, 80, {9, 5}}));

// Landmark 2 is the first slot of one factor and the second slot of another of the same family;
// landmark 3 has constant frames only; landmark 4 is seen twice by frame 0.
TEST(LandmarkIncidences, LandmarksInAnySlotWithConstantsAndTwiceTheSameFrame) {
  RandomGraph random(5);
  random.AddFrame(3);
  random.graph().SetConstant(random.AddFrame(3), true);
  random.AddLandmark(3);
  random.AddLandmark(3);
  random.AddLandmark(3);
  random.Connect(2, {2, 0});
  random.Connect(2, {0, 2});
  random.Connect(2, {1, 3});
  random.Connect(2, {0, 4});
  random.Connect(2, {4, 0});
  const CorePipeline core(random.graph());
  ASSERT_TRUE(core.status.ok()) << core.status.message;
  EXPECT_EQ(core.incidences.begin, (std::vector<int>{0, 1, 1, 2}));
  EXPECT_EQ(core.incidences.frames, (UnwrittenVector<std::int32_t>{0, 0}));
  EXPECT_EQ(core.incidences.factors_begin, (std::vector<int>{0, 2, 3, 5}));
}

TEST(LandmarkIncidences, WithoutLandmarksEverythingIsEmpty) {
  RandomGraph random(5);
  random.Connect(3, {random.AddFrame(3), random.AddFrame(2)});
  const CorePipeline core(random.graph());
  EXPECT_EQ(core.incidences.num_landmarks(), 0);
  EXPECT_EQ(core.incidences.chunk_begin, (std::vector<int>{0, 0}));
  EXPECT_EQ(core.incidences.y_quads, 0);
  EXPECT_TRUE(core.incidences.factors.empty());
}

}  // namespace
}  // namespace inceres::internal
