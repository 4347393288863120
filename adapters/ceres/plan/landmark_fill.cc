#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "adapters/ceres/plan/landmark_selection.h"
#include "adapters/ceres/plan/reduced_graph.h"
#include "adapters/ceres/read/index.h"
#include "src/linear/reduced_prediction.h"
#include "src/simd/kernels.h"

namespace inceres::internal {
namespace {

constexpr double kAlwaysFine = 300.0;  // unknowns of S
// flops of a step: as long as evaluating takes, and a tenth of the analysis
constexpr double kCheapPerSlot = 1000.0;
constexpr double kLongTracks[] = {2, 4, 8};  // shares of the unknowns of S
constexpr double kLessFill = 0.7;            // S must lose so much before it is worth analyzing
constexpr double kAdvantage = 0.8;           // of what is not the selection itself
constexpr double kAlwaysFits = 64.0 * (1 << 20);

// Of a block of S in lists and plans, and of a product that makes it up.
constexpr double kBytesPerBlock = 48.0;
constexpr double kBytesPerProduct = 8.0;
constexpr double kBytesPerSlot = 40.0;           // of lists beside the Jacobian
constexpr double kBytesPerEnvelopeEntry = 24.0;  // of S, the factor, and what waits to go into it

struct Choice {
  std::vector<char> is_landmark;
  double cost = std::numeric_limits<double>::infinity();
  double bytes = std::numeric_limits<double>::infinity();
};

class FillChooser {
 public:
  FillChooser(const ProblemView& view, const AvailableMemory& available,
              LandmarkSelection* selection)
      : view_(view), available_(available), selection_(*selection) {}

  void Run() {
    double frames_size = view_.reduced.num_effective_parameters;
    for (std::size_t b = 0; b < view_.blocks.size(); ++b) {
      landmarks_size_ += selection_.is_landmark[b] != 0 ? view_.blocks[b].tangent_size : 0;
    }
    frames_size -= landmarks_size_;
    const double cheap = kCheapPerSlot * static_cast<double>(view_.slots.size());
    if (frames_size <= kAlwaysFine || (PredictFullSystem(frames_size).cost <= cheap &&
                                       frames_size * frames_size < kAlwaysFits / 12.0)) {
      return;
    }
    SumCommonBytes();
    const ReducedGraph graph(view_, selection_.is_landmark);
    const Choice bound = AtMost(graph);
    const bool fits = Fits(bound.bytes);
    if (bound.cost <= cheap && fits) {
      return;
    }
    Choice best = BestOther(graph, fits);
    if (!fits || best.cost < std::numeric_limits<double>::infinity()) {
      Decide(graph, std::move(best));
    }
  }

 private:
  // What every choice takes: Jacobians, residuals, lists.
  void SumCommonBytes() {
    for (const int r : view_.moving) {
      const ResidualBlockView& residual = view_.residuals[At(r)];
      double row = 2.0;
      double pairs = 0.0;
      for (int s = 0; s < residual.num_slots; ++s) {
        const int padded_size = PadToQuad(view_.block(view_.SlotsOf(residual)[s]).tangent_size);
        row += padded_size;
        pairs += s + 1;
      }
      common_bytes_ += sizeof(double) * residual.num_residuals * row +
                       kBytesPerSlot * residual.num_slots + kBytesPerProduct * pairs;
    }
  }

  // The selection itself, at least and at most.
  static double AtLeast(const ReducedGraph& graph) {
    return graph.elimination_flops() + std::pow(graph.largest_clique(), 3) / 3.0;
  }
  Choice AtMost(const ReducedGraph& graph) const {
    Choice choice;
    const ReducedPrediction full = PredictFullSystem(graph.size());
    const ReducedGraph::Envelope envelope = graph.EnvelopeOfAppearance();
    choice.cost = graph.elimination_flops() + std::min(full.cost, envelope.flops);
    choice.bytes = Bytes(graph, std::min(full.bytes, kBytesPerEnvelopeEntry * envelope.entries),
                         BlocksAtMost(graph));
    return choice;
  }

  static double BlocksAtMost(const ReducedGraph& graph) {
    return std::min(0.5 * graph.num_frames() * graph.num_frames(), graph.num_pairs());
  }
  double Bytes(const ReducedGraph& graph, double solver, double blocks) const {
    return common_bytes_ + solver + kBytesPerBlock * blocks +
           kBytesPerProduct * graph.num_landmark_pairs();
  }

  bool Fits(double bytes) {
    if (bytes <= kAlwaysFits || !available_) {
      return true;
    }
    if (available_bytes_ < 0.0) {
      available_bytes_ = available_();
    }
    return bytes <= available_bytes_;
  }

  // By the symbolic analysis, unless S is full anyway.
  Choice Predict(const ReducedGraph& graph, std::vector<char> is_landmark, double fill) const {
    Choice choice;
    choice.is_landmark = std::move(is_landmark);
    ReducedPrediction prediction;
    double blocks = BlocksAtMost(graph);
    if (IsSolvedDensely(graph.size(), fill)) {
      prediction = PredictFullSystem(graph.size());
    } else {
      const BlockPattern pattern = graph.Pattern();
      blocks = static_cast<double>(pattern.columns.size());
      if (!PredictReducedSolver(pattern, &prediction).ok()) {
        return choice;
      }
    }
    choice.cost = graph.elimination_flops() + prediction.cost;
    choice.bytes = Bytes(graph, prediction.bytes, blocks);
    return choice;
  }

  // The selection without landmarks that meet this many unknowns; empty if that are none, or too
  // many unknowns themselves.
  std::vector<char> Without(const ReducedGraph& graph, double frames_size,
                            bool at_any_price) const {
    std::vector<char> is_landmark = selection_.is_landmark;
    double kept = 0.0;
    for (std::size_t b = 0; b < is_landmark.size(); ++b) {
      if (is_landmark[b] != 0 && graph.FramesSize(static_cast<int>(b)) >= frames_size) {
        is_landmark[b] = 0;
        kept += view_.blocks[b].tangent_size;
      }
    }
    return kept > 0.0 && (at_any_price || kept <= graph.size()) ? is_landmark : std::vector<char>();
  }

  // The cheapest other choice, of those that fit if any does.
  Choice BestOther(const ReducedGraph& graph, bool selection_fits) {
    std::vector<double> shares(std::begin(kLongTracks), std::end(kLongTracks));
    shares.push_back(std::numeric_limits<double>::infinity());
    fill_ = graph.SampleFill();
    std::vector<char> previous = selection_.is_landmark;
    Choice best;
    for (const double share : shares) {
      std::vector<char> is_landmark = Without(graph, graph.size() / share, !selection_fits);
      if (is_landmark.empty() || is_landmark == previous) {
        continue;
      }
      previous = is_landmark;
      const ReducedGraph other(view_, is_landmark);
      const double size = other.size() / graph.size();
      const double fill = other.SampleFill();
      if (selection_fits && fill * size * size > kLessFill * fill_) {
        continue;
      }
      Choice choice = Predict(other, std::move(is_landmark), fill);
      if (IsBetter(choice, best, 1.0)) {
        best = std::move(choice);
      }
    }
    return best;
  }

  // What fits before what does not, then what is cheaper; of what does not fit, what is leaner.
  bool IsBetter(const Choice& a, const Choice& b, double advantage) {
    const bool a_fits = Fits(a.bytes);
    const bool b_fits = Fits(b.bytes);
    if (a_fits != b_fits) {
      return a_fits;
    }
    return a_fits ? a.cost < advantage * b.cost : a.bytes < b.bytes;
  }

  void Decide(const ReducedGraph& graph, Choice other) {
    if (AtLeast(graph) * kAdvantage < other.cost || !Fits(other.bytes)) {
      const Choice itself = Predict(graph, selection_.is_landmark, fill_);
      if (!IsBetter(other, itself, kAdvantage)) {
        other = itself;
      }
    }
    if (!Fits(other.bytes)) {
      const auto mebibytes = [](double bytes) {
        return std::to_string(static_cast<long>(bytes / (1 << 20))) + " MiB";
      };
      selection_.obstacle = "memory: a solve is predicted to take " + mebibytes(other.bytes) +
                            " at least, " + mebibytes(available_bytes_) + " are available";
      return;
    }
    for (std::size_t b = 0; b < other.is_landmark.size(); ++b) {
      selection_.num_kept += selection_.is_landmark[b] - other.is_landmark[b];
    }
    selection_.num_landmarks -= selection_.num_kept;
    selection_.is_landmark = std::move(other.is_landmark);
  }

  const ProblemView& view_;
  const AvailableMemory& available_;
  LandmarkSelection& selection_;
  double landmarks_size_ = 0.0;
  double common_bytes_ = 0.0;
  double available_bytes_ = -1.0;
  double fill_ = 0.0;  // of S as the selection leaves it
};

}  // namespace

void KeepLongTracks(const ProblemView& view, const AvailableMemory& available,
                    LandmarkSelection* selection) {
  if (selection->num_landmarks > 0 || available) {
    FillChooser(view, available, selection).Run();
  }
}

}  // namespace inceres::internal
