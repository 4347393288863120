#include "adapters/ceres/plan/landmark_selection.h"

#include <algorithm>
#include <climits>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "adapters/ceres/plan/block_graph.h"
#include "adapters/ceres/read/index.h"
#include "src/base/aligned_vector.h"
#include "src/base/counting_sort.h"
#include "src/base/executor.h"

namespace inceres::internal {
namespace {

constexpr int kMinResidualsForShareRule = 10;
constexpr int kShareRule = 5;  // a landmark touches less than one in this many residual blocks
constexpr double kHandling = 100.0;
constexpr double kSparseFactor = 4.0;

constexpr int kBlockGrain = 4096;  // a few of their residual blocks each
constexpr int kMostTasks = 32;     // each has a table over all blocks

// Kinds of blocks, by union-find over the places that they stand in: the slots of all shapes.
class KindFinder {
 public:
  KindFinder(std::size_t num_blocks, int num_places)
      : place_of_(num_blocks, -1), parent_(At(num_places)) {
    std::iota(parent_.begin(), parent_.end(), 0);
  }

  void Stands(int block, int place) {
    int& known = place_of_[At(block)];
    if (known < 0) {
      known = place;
    } else if (known != place) {
      parent_[At(Root(known))] = Root(place);
    }
  }
  // A number below that of the places, of a block that stands somewhere.
  int KindOf(int block) { return Root(place_of_[At(block)]); }

 private:
  int Root(int place) {
    while (parent_[At(place)] != place) {
      place = parent_[At(place)] = parent_[At(parent_[At(place)])];
    }
    return place;
  }

  std::vector<int> place_of_;  // any of them
  std::vector<int> parent_;    // per place
};

// One kind of candidates and the two predictions for it.
struct Kind {
  std::vector<int> blocks;
  double unknowns = 0.0;
  double eliminate = 0.0;    // Σ e D² + o
  double keep_sparse = 0.0;  // Σ 4 e (D + e)² + o
  // The first slot of the first residual block that touches it: kinds of one cost go by it, not by
  // addresses.
  std::pair<int, int> first_use = {std::numeric_limits<int>::max(), 0};

  double CostPerUnknown() const { return eliminate / unknowns; }
};

class Chooser {
 public:
  Chooser(const ProblemView& view, const ShapeTable& shapes, int num_threads)
      : view_(view),
        shapes_(shapes),
        threads_(num_threads),
        candidate_(view.blocks.size(), 0),
        kinds_(view.blocks.size(), shapes.num_places) {}

  LandmarkSelection Run() {
    LandmarkSelection selection(view_.blocks.size());
    if (NothingIsWorthIt() || MarkCandidates() == 0) {
      return selection;
    }
    FindKinds();
    DropThoseThatMeetTheirOwnKind();
    IndexResiduals();
    std::vector<Kind> kinds = CollectKinds();
    std::stable_sort(kinds.begin(), kinds.end(), [](const Kind& a, const Kind& b) {
      return std::make_pair(a.CostPerUnknown(), a.first_use) <
             std::make_pair(b.CostPerUnknown(), b.first_use);
    });
    taken_.assign(view_.residuals.size(), 0);
    unknowns_left_ = view_.reduced.num_effective_parameters;
    for (const Kind& kind : kinds) {
      if (selection.num_landmarks == 0) {
        Take(kind, &selection);
      } else {
        Take(WithoutTaken(kind), &selection);
      }
    }
    return selection;
  }

 private:
  // The densest factorization of all there is costs less than handling one landmark.
  bool NothingIsWorthIt() const {
    return std::pow(view_.reduced.num_effective_parameters, 3) / 3.0 <= kHandling;
  }

  int MarkCandidates() {
    const int num_residuals = view_.reduced.num_residual_blocks;
    int count = 0;
    for (std::size_t b = 0; b < view_.blocks.size(); ++b) {
      const ParameterBlockView& block = view_.blocks[b];
      const bool everywhere = num_residuals >= kMinResidualsForShareRule &&
                              kShareRule * static_cast<long>(block.degree) >= num_residuals;
      candidate_[b] = block.reduced() && block.tangent_size <= kMaxLandmarkSize && !everywhere;
      count += candidate_[b];
    }
    return count;
  }

  // Lists where candidates stand, one or two places of the many in most residual blocks.
  void FindKinds() {
    places_.reserve(view_.moving.size());
    for (const int r : view_.moving) {
      const ResidualBlockView& residual = view_.residuals[At(r)];
      const int* const blocks = view_.SlotsOf(residual);
      const int first_place = shapes_.ShapeOf(At(r)).first_place;
      const std::size_t num_before = places_.size();
      for (int s = 0; s < residual.num_slots; ++s) {
        if (candidate_[At(blocks[s])] != 0) {
          places_.push_back({r, blocks[s]});
          kinds_.Stands(blocks[s], first_place + s);
        }
      }
      any_meet_ = any_meet_ || places_.size() > num_before + 1;
    }
  }

  // `met[kind]` remembers the residual block in which a kind was last met, and the block it was met
  // in.
  void DropThoseThatMeetTheirOwnKind() {
    struct Meeting {
      int residual = -1;
      int block = -1;
    };
    if (!any_meet_) {
      return;
    }
    std::vector<Meeting> met(At(shapes_.num_places));
    std::vector<int> dropped;
    for (const auto [r, b] : places_) {
      Meeting& meeting = met[At(kinds_.KindOf(b))];
      if (meeting.residual == r) {
        dropped.push_back(b);
        dropped.push_back(meeting.block);
      }
      meeting = {r, b};
    }
    for (const int b : dropped) {
      candidate_[At(b)] = 0;
    }
  }

  void IndexResiduals() {
    const int num_blocks = static_cast<int>(view_.blocks.size());
    CountingSort(
        threads_, num_blocks, static_cast<int>(places_.size()),
        [this](int i) {
          const int b = places_[At(i)].block;
          return candidate_[At(b)] != 0 ? b : -1;
        },
        &residuals_begin_, &residuals_);
    frames_size_.assign(view_.blocks.size(), 0.0);
    const int grain = std::max(kBlockGrain, num_blocks / kMostTasks);
    threads_.For(num_blocks, grain, [this](int begin, int end) {
      for (int k = residuals_begin_[At(begin)]; k < residuals_begin_[At(end)]; ++k) {
        residuals_[At(k)] = places_[At(residuals_[At(k)])].residual;
      }
      FindFramesSizes(begin, end);
    });
  }

  // Of each candidate.
  CompressedRows::Row ResidualsOf(int b) const {
    return {residuals_.data() + residuals_begin_[At(b)],
            residuals_.data() + residuals_begin_[At(b) + 1]};
  }

  std::vector<Kind> CollectKinds() {
    std::vector<int> kind_of(At(shapes_.num_places), -1);
    std::vector<Kind> kinds;
    for (std::size_t b = 0; b < view_.blocks.size(); ++b) {
      if (candidate_[b] == 0) {
        continue;
      }
      int& kind = kind_of[At(kinds_.KindOf(static_cast<int>(b)))];
      if (kind < 0) {
        kind = static_cast<int>(kinds.size());
        kinds.emplace_back();
      }
      Add(static_cast<int>(b), &kinds[At(kind)]);
    }
    return kinds;
  }

  // D: summed tangent size of the variable blocks that share a residual block with each candidate
  // of these blocks.
  void FindFramesSizes(int begin, int end) {
    std::vector<int> seen_by(view_.blocks.size(), -1);
    for (int b = begin; b < end; ++b) {
      if (candidate_[At(b)] == 0) {
        continue;
      }
      seen_by[At(b)] = b;
      for (const int r : ResidualsOf(b)) {
        const ResidualBlockView& residual = view_.residuals[At(r)];
        const int* const blocks = view_.SlotsOf(residual);
        for (const int* other = blocks; other < blocks + residual.num_slots; ++other) {
          if (std::exchange(seen_by[At(*other)], b) != b && !view_.block(*other).constant) {
            frames_size_[At(b)] += view_.block(*other).tangent_size;
          }
        }
      }
    }
  }

  void Add(int b, Kind* kind) const {
    const double e = view_.block(b).tangent_size;
    const double D = frames_size_[At(b)];
    kind->blocks.push_back(b);
    if (*ResidualsOf(b).first <= kind->first_use.first) {
      kind->first_use = std::min(kind->first_use, FirstUse(b));
    }
    kind->unknowns += e;
    kind->eliminate += e * D * D + kHandling;
    kind->keep_sparse += kSparseFactor * e * (D + e) * (D + e) + kHandling;
  }

  std::pair<int, int> FirstUse(int b) const {
    const int r = *ResidualsOf(b).first;
    return {r, view_.FindSlot(view_.residuals[At(r)], [b](int other) { return other == b; })};
  }

  // The part of a kind that shares no residual block with a landmark already taken.
  Kind WithoutTaken(const Kind& kind) const {
    Kind free;
    for (const int b : kind.blocks) {
      const auto residuals = ResidualsOf(b);
      if (std::none_of(residuals.begin(), residuals.end(),
                       [&](int r) { return taken_[At(r)] != 0; })) {
        Add(b, &free);
      }
    }
    return free;
  }

  void Take(const Kind& kind, LandmarkSelection* selection) {
    const double left_after = unknowns_left_ - kind.unknowns;
    const double keep_dense = (std::pow(unknowns_left_, 3) - std::pow(left_after, 3)) / 3.0;
    if (kind.blocks.empty() || kind.eliminate >= std::min(keep_dense, kind.keep_sparse)) {
      return;
    }
    unknowns_left_ = left_after;
    for (const int b : kind.blocks) {
      selection->is_landmark[At(b)] = 1;
      ++selection->num_landmarks;
      for (const int r : ResidualsOf(b)) {
        taken_[At(r)] = 1;
      }
    }
  }

  const ProblemView& view_;
  const ShapeTable& shapes_;
  const Executor threads_;
  // A residual block and a candidate of its blocks, in the order of its slots.
  struct Place {
    int residual;
    int block;
  };
  std::vector<char> candidate_;
  std::vector<Place> places_;
  KindFinder kinds_;
  bool any_meet_ = false;             // candidates in one residual block
  std::vector<int> residuals_begin_;  // per block, one more
  UnwrittenVector<int> residuals_;    // of each candidate
  std::vector<double> frames_size_;   // per block
  std::vector<char> taken_;
  double unknowns_left_ = 0.0;
};

// As Ceres orders the blocks that it does not eliminate where nobody has told it how: by their
// number of neighbors, blocks with as many by first appearance.
std::vector<int> FramesByDegree(const BlockGraph& graph, const LandmarkSelection& eliminated) {
  std::vector<int> frames;
  for (const int b : graph.order()) {
    if (!eliminated.Contains(b)) {
      frames.push_back(b);
    }
  }
  std::stable_sort(frames.begin(), frames.end(), [&](int a, int b) {
    return graph.Neighbors(a).size() < graph.Neighbors(b).size();
  });
  return frames;
}

// Where conjugate gradients stop depends on what was eliminated: exactly what Ceres eliminates.
LandmarkSelection LandmarksOfIterativeSolver(const ProblemView& view, const OrderingView& ordering,
                                             ceres::LinearSolverType type) {
  OrderingView eliminated;
  if (LandmarksAreGiven(ordering, type)) {
    eliminated.first_group = ordering.first_group;
  } else if (IsSchurType(type)) {
    const BlockGraph graph(view);
    eliminated.first_group = IndependentSets(graph).TakeOne();
  }
  LandmarkSelection selection = LandmarksOfFirstGroup(view, eliminated);
  if (selection.num_too_large > 0) {
    selection = LandmarkSelection(view.blocks.size());
    selection.large.assign(eliminated.first_group.begin(), eliminated.first_group.end());
  }
  if (ordering.numbers_frames && IsSchurType(type)) {
    selection.frames_in_order =
        LandmarksAreGiven(ordering, type)
            ? ordering.later_groups
            : FramesByDegree(BlockGraph(view),
                             LandmarksOfFirstGroup(view, eliminated, /*max_size=*/INT_MAX));
  }
  return selection;
}

}  // namespace

LandmarkSelection LandmarksOfFirstGroup(const ProblemView& view, const OrderingView& ordering,
                                        int max_size) {
  LandmarkSelection selection(view.blocks.size());
  for (const int b : ordering.first_group) {
    const bool small = view.block(b).tangent_size <= max_size;
    selection.is_landmark[At(b)] = small;
    ++(small ? selection.num_landmarks : selection.num_too_large);
  }
  return selection;
}

LandmarkSelection ChooseLandmarks(const ProblemView& view, const ShapeTable& shapes,
                                  int num_threads) {
  return Chooser(view, shapes, num_threads).Run();
}

LandmarkSelection SelectLandmarks(const ProblemView& view, const OrderingView& ordering,
                                  const ShapeTable& shapes, ceres::LinearSolverType type,
                                  const AvailableMemory& available, int num_threads) {
  if (type == ceres::DENSE_QR) {
    return LandmarkSelection(view.blocks.size());
  }
  if (IsIterative(type)) {
    return LandmarksOfIterativeSolver(view, ordering, type);
  }
  LandmarkSelection selection = LandmarksAreGiven(ordering, type)
                                    ? LandmarksOfFirstGroup(view, ordering)
                                    : ChooseLandmarks(view, shapes, num_threads);
  KeepLongTracks(view, available, &selection);
  return selection;
}

LandmarkSelection WithLarge(const LandmarkSelection& landmarks) {
  LandmarkSelection eliminated = landmarks;
  for (const int block : landmarks.large) {
    eliminated.is_landmark[At(block)] = 1;
    ++eliminated.num_landmarks;
  }
  return eliminated;
}

}  // namespace inceres::internal
