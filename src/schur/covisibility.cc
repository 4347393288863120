#include "schur/covisibility.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "base/counting_sort.h"

namespace inceres::internal {

// Which frames belong together (docs/algorithms.md, "Reduced linear systems", aggregates): a graph
// of the frames whose weights count what two of them have in common. Everything is a count of
// connections; no value of a Jacobian is looked at, so the graph serves for as long as the
// structure stays.
//
// Weights are sums of ones, exact in any order, and a row is made by one task: the graph is the
// same for any number of threads.
//
// Without a limit a landmark seen from n frames would add n² to the work. Where it is seen from
// very many, each of its frames is tied to some before and behind it in the landmark's list only,
// which in a sequence are those nearest in time.

namespace {

// A frame is shared if in most of its factors another one has less than this share of as many.
constexpr double kFewFactors = 1.0 / 8.0;
// Of a landmark seen from more frames than twice this and one, each is tied to so many before it
// and behind it. Shorter tracks tie all of their frames to each other.
constexpr int kTrackNeighbors = 8;
constexpr int kRowGrain = 64;

// visit(frames, count): the frames of each factor that touches any.
// In the order of families and factors: callers only count.
template <typename Visit>
void ForEachFactor(const Evaluator& evaluator, const Visit& visit) {
  std::vector<int> frames;
  for (const Linearization& cache : evaluator.families()) {
    // It may have no variables to point to.
    if (cache.num_factors == 0) {
      continue;
    }
    const VariableId* ids = evaluator.graph().Variables(cache.id, 0);
    for (int i = 0; i < cache.num_factors; ++i, ids += cache.num_slots) {
      frames.clear();
      for (int s = 0; s < cache.num_slots; ++s) {
        // −1 of landmarks, of constants and of free places.
        const int frame = evaluator.layout().FrameOf(ids[s]);
        if (frame >= 0) {
          frames.push_back(frame);
        }
      }
      if (!frames.empty()) {
        visit(frames);
      }
    }
  }
}

// visit(frame) for each incidence of the landmark that counts with this one.
template <typename Visit>
void ForEachCovisible(const LandmarkIncidences& incidences, int incidence, const Visit& visit) {
  const int landmark = incidences.landmarks[incidence];
  const int begin = incidences.begin[landmark];
  const int count = incidences.begin[landmark + 1] - begin;
  if (count <= 2 * kTrackNeighbors + 1) {
    for (int other = begin; other < begin + count; ++other) {
      visit(incidences.frames[other]);
    }
    return;
  }
  const int place = incidence - begin;
  // Twice as many as kTrackNeighbors are fewer than the others of this landmark: none is met twice.
  for (int shift = 1; shift <= kTrackNeighbors; ++shift) {
    // The list is taken for a ring, so that its ends have as many neighbors as the rest and ties
    // are mutual.
    visit(incidences.frames[begin + (place + shift) % count]);
    visit(incidences.frames[begin + (place + count - shift) % count]);
  }
}

// The edges of some rows.
struct Rows {
  std::vector<int> counts;
  std::vector<int> neighbors;
  std::vector<double> weights;
};

// Tasks are stretches of rows, so their lists follow one another.
WeightedGraph Joined(const std::vector<Rows>& tasks) {
  WeightedGraph graph;
  for (const Rows& rows : tasks) {
    for (const int count : rows.counts) {
      graph.begin.push_back(graph.begin.back() + count);
    }
    graph.neighbors.insert(graph.neighbors.end(), rows.neighbors.begin(), rows.neighbors.end());
    graph.weights.insert(graph.weights.end(), rows.weights.begin(), rows.weights.end());
  }
  return graph;
}

}  // namespace

// Doubles, for processes add them up as such.
std::vector<double> CountFactorsOfFrames(const Evaluator& evaluator) {
  std::vector<double> factors(evaluator.layout().num_frames, 0.0);
  ForEachFactor(evaluator, [&](const std::vector<int>& frames) {
    for (const int frame : frames) {
      factors[frame] += 1.0;
    }
  });
  return factors;
}

std::vector<double> CountFactorsBesideFew(const Evaluator& evaluator,
                                          const std::vector<double>& factors) {
  std::vector<double> beside_few(factors.size(), 0.0);
  ForEachFactor(evaluator, [&](const std::vector<int>& frames) {
    // A frame by itself in a factor is not beside anyone: fewest is its own count then.
    double fewest = std::numeric_limits<double>::max();
    for (const int frame : frames) {
      fewest = std::min(fewest, factors[frame]);
    }
    for (const int frame : frames) {
      beside_few[frame] += fewest < kFewFactors * factors[frame] ? 1.0 : 0.0;
    }
  });
  return beside_few;
}

std::vector<char> FindSharedFrames(const std::vector<double>& factors,
                                   const std::vector<double>& beside_few) {
  std::vector<char> is_shared(factors.size());
  for (std::size_t i = 0; i < factors.size(); ++i) {
    // More than half of its factors, so that frames without factors are not shared.
    is_shared[i] = 2.0 * beside_few[i] > factors[i] ? 1 : 0;
  }
  return is_shared;
}

std::vector<char> FindSharedFrames(const Evaluator& evaluator) {
  const std::vector<double> factors = CountFactorsOfFrames(evaluator);
  return FindSharedFrames(factors, CountFactorsBesideFew(evaluator, factors));
}

Companions::Companions(const Evaluator& evaluator, const std::vector<char>& is_shared) {
  // Lists by counting sort: how many companions each frame has, where its list begins, who they
  // are. Two passes over the factors, and no list of pairs.
  const auto for_each_pair = [&](const auto& add) {
    ForEachFactor(evaluator, [&](const std::vector<int>& touched) {
      for (const int i : touched) {
        for (const int j : touched) {
          if (i != j && is_shared[i] == 0 && is_shared[j] == 0) {
            add(i, j);
          }
        }
      }
    });
  };
  CountingSort(evaluator.layout().num_frames, for_each_pair, &begin, &frames);
}

// Row by row: frames that share landmarks with the row's own, over the incidences, and those that
// share factors without one as well, over the companions. Both count one each.
WeightedGraph CovisibilityGraph(const Evaluator& evaluator, const LandmarkIncidences& incidences,
                                const std::vector<char>& is_shared) {
  const int num_frames = evaluator.layout().num_frames;
  const Companions companions(evaluator, is_shared);
  const int num_tasks = (num_frames + kRowGrain - 1) / kRowGrain;
  std::vector<Rows> tasks(num_tasks);
  evaluator.executor().For(num_tasks, 1, [&](int begin_task, int end_task) {
    // A dense row, zero but for the frames in `found`; taking a weight out zeroes it again.
    std::vector<double> weight(num_frames, 0.0);
    std::vector<int> found;
    for (int task = begin_task; task < end_task; ++task) {
      const int end_row = std::min(num_frames, (task + 1) * kRowGrain);
      for (int row = task * kRowGrain; row < end_row; ++row) {
        const auto add = [&](int other) {
          if (other != row && is_shared[other] == 0 && is_shared[row] == 0) {
            // Weights only grow: zero is one that has not been met.
            if (weight[other] == 0.0) {
              found.push_back(other);
            }
            weight[other] += 1.0;
          }
        };
        for (int k = incidences.frame_begin[row]; k < incidences.frame_begin[row + 1]; ++k) {
          ForEachCovisible(incidences, incidences.frame_incidences[k], add);
        }
        for (int k = companions.begin[row]; k < companions.begin[row + 1]; ++k) {
          add(companions.frames[k]);
        }
        // Neighbors ascending, as WeightedGraph has them.
        std::sort(found.begin(), found.end());
        tasks[task].counts.push_back(static_cast<int>(found.size()));
        for (const int other : found) {
          tasks[task].neighbors.push_back(other);
          tasks[task].weights.push_back(std::exchange(weight[other], 0.0));
        }
        found.clear();
      }
    }
  });
  return Joined(tasks);
}

}  // namespace inceres::internal
