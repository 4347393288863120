#include "linearize/product_plan.h"

#include <set>

#include <gtest/gtest.h>

#include "support/core_pipeline.h"
#include "support/random_graph.h"

namespace inceres::internal {
namespace {

using test::BundleOptions;
using test::CorePipeline;
using test::MakeBundle;
using test::RandomGraph;

class Plans : public testing::TestWithParam<bool> {
 protected:
  Plans()
      : bundle_(MakeBundle(Options())),
        core_(bundle_->graph(), /*eliminate_landmarks=*/GetParam()) {}

  static BundleOptions Options() {
    BundleOptions options;
    options.num_frames = 11;
    options.frame_sizes = {6, 9, 3, 15};
    options.landmark_sizes = {3, 1};
    options.hosted = true;
    options.constants = true;
    return options;
  }

  // Pairs (i ≥ j) of frames that a factor or a landmark connects.
  std::set<std::pair<int, int>> ConnectedPairs() const {
    std::set<std::pair<int, int>> pairs;
    const auto add_all = [&pairs](const std::set<int>& frames) {
      for (const int a : frames) {
        for (const int b : frames) {
          pairs.emplace(std::max(a, b), std::min(a, b));
        }
      }
    };
    std::vector<std::set<int>> of_landmark(static_cast<std::size_t>(core_.layout.num_landmarks()));
    const FactorGraph& graph = bundle_->graph();
    for (FamilyId id = 0; id < graph.num_families(); ++id) {
      for (int i = 0; i < graph.NumFactors(id); ++i) {
        std::set<int> frames;
        int landmark = -1;
        for (int s = 0; s < graph.family(id).num_slots(); ++s) {
          const VariableId variable = graph.Variables(id, i)[s];
          landmark = std::max(landmark, core_.layout.LandmarkOf(variable));
          if (core_.layout.FrameOf(variable) >= 0) {
            frames.insert(core_.layout.FrameOf(variable));
          }
        }
        add_all(frames);
        if (landmark >= 0) {
          of_landmark[static_cast<std::size_t>(landmark)].insert(frames.begin(), frames.end());
        }
      }
    }
    for (const std::set<int>& frames : of_landmark) {
      add_all(frames);
    }
    return pairs;
  }

  std::unique_ptr<RandomGraph> bundle_;
  CorePipeline core_;
};

TEST_P(Plans, PatternIsTheLowerTriangleOfConnectedFrames) {
  const BlockPattern& pattern = core_.plans.pattern;
  ASSERT_EQ(pattern.num_blocks(), core_.layout.num_frames);
  EXPECT_EQ(pattern.size(), core_.layout.frame_size());
  std::set<std::pair<int, int>> found;
  std::int64_t values = 0;
  for (int row = 0; row < pattern.num_blocks(); ++row) {
    const auto r = static_cast<std::size_t>(row);
    EXPECT_EQ(pattern.block_size(row), core_.layout.TangentSize(row));
    EXPECT_EQ(pattern.columns[static_cast<std::size_t>(pattern.row_begin[r + 1]) - 1], row)
        << "the diagonal is last";
    for (int k = pattern.row_begin[r]; k < pattern.row_begin[r + 1]; ++k) {
      const auto b = static_cast<std::size_t>(k);
      EXPECT_EQ(core_.plans.block_row[b], row);
      EXPECT_TRUE(k == pattern.row_begin[r] || pattern.columns[b - 1] < pattern.columns[b])
          << "columns ascend";
      EXPECT_EQ(pattern.value_begin[b], values);
      values += std::int64_t{pattern.block_size(row)} * pattern.block_size(pattern.columns[b]);
      found.emplace(row, pattern.columns[b]);
    }
  }
  EXPECT_EQ(pattern.value_begin.back(), values);
  EXPECT_EQ(found, ConnectedPairs());
}

TEST_P(Plans, SegmentsPartTheTermsAndNameTheirSourceOnce) {
  for (const ProductPlan* plan : {&core_.plans.hessian, &core_.plans.schur}) {
    ASSERT_EQ(plan->segments_begin.size(), core_.plans.block_row.size() + 1);
    EXPECT_EQ(plan->segments_begin.back(), static_cast<int>(plan->segments.size()));
    int next = 0;
    for (std::size_t block = 0; block + 1 < plan->segments_begin.size(); ++block) {
      std::set<int> sources;
      for (int s = plan->segments_begin[block]; s < plan->segments_begin[block + 1]; ++s) {
        const ProductPlan::Segment& segment = plan->segments[static_cast<std::size_t>(s)];
        EXPECT_EQ(segment.first_term, next);
        EXPECT_GT(segment.count, 0);
        EXPECT_TRUE(sources.insert(segment.source).second) << "one call of the kernel would do";
        next += segment.count;
      }
    }
    EXPECT_EQ(next, static_cast<int>(plan->terms.size()));
  }
}

TEST_P(Plans, TermsPointIntoTheirArrays) {
  for (const ProductPlan::Segment& segment : core_.plans.hessian.segments) {
    const FramePlans::HessianSource& source =
        core_.plans.hessian_sources[static_cast<std::size_t>(segment.source)];
    const Linearization& cache =
        core_.evaluator.families()[static_cast<std::size_t>(source.family)];
    for (std::int64_t t = segment.first_term; t < segment.first_term + segment.count; ++t) {
      const ProductTerm& term = core_.plans.hessian.terms[static_cast<std::size_t>(t)];
      const std::ptrdiff_t a_stride =
          cache.slots[static_cast<std::size_t>(source.column_slot)].factor_stride;
      const std::ptrdiff_t b_stride =
          cache.slots[static_cast<std::size_t>(source.row_slot)].factor_stride;
      EXPECT_EQ(term.a * kQuad % a_stride, 0);
      const std::ptrdiff_t factor = term.a * kQuad / a_stride;
      EXPECT_EQ(factor, source.row_slot == source.column_slot ? term.b / cache.residual_size
                                                              : term.b * kQuad / b_stride)
          << "both operands are of the same factor, or its residual goes with it";
      EXPECT_LT(factor, cache.num_factors);
    }
  }
  const ProductPlan& schur = core_.plans.schur;
  for (std::size_t block = 0; block < core_.plans.block_row.size(); ++block) {
    const bool is_diagonal = core_.plans.block_row[block] == core_.plans.pattern.columns[block];
    for (int s = schur.segments_begin[block]; s < schur.segments_begin[block + 1]; ++s) {
      const ProductPlan::Segment& segment = schur.segments[static_cast<std::size_t>(s)];
      for (std::int64_t t = segment.first_term; t < segment.first_term + segment.count; ++t) {
        const ProductTerm& term = schur.terms[static_cast<std::size_t>(t)];
        EXPECT_LT(term.a, core_.incidences.y_quads);
        EXPECT_LT(term.b, is_diagonal ? core_.incidences.num_landmarks() * kQuad
                                      : core_.incidences.y_quads);
      }
    }
  }
}

// Every landmark with k frames gives k (k + 1) / 2 products of Y.
TEST_P(Plans, NumberOfSchurProducts) {
  std::size_t expected = 0;
  for (int l = 0; l < core_.incidences.num_landmarks(); ++l) {
    const auto i = static_cast<std::size_t>(l);
    const auto k =
        static_cast<std::size_t>(core_.incidences.begin[i + 1] - core_.incidences.begin[i]);
    expected += k * (k + 1) / 2;
  }
  EXPECT_EQ(core_.plans.schur.terms.size(), expected);
  EXPECT_EQ(expected > 0, GetParam());
}

INSTANTIATE_TEST_SUITE_P(Elimination, Plans, testing::Bool());

TEST(FramePlans, LandmarksAlone) {
  RandomGraph random(2);
  random.Connect(3, {random.AddLandmark(3)});
  const CorePipeline core(random.graph());
  EXPECT_EQ(core.plans.pattern.num_blocks(), 0);
  EXPECT_EQ(core.plans.pattern.size(), 0);
  EXPECT_TRUE(core.plans.schur.terms.empty());
}

}  // namespace
}  // namespace inceres::internal
