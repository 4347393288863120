#include "schur/gauge_modes.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace inceres::internal {
namespace {

constexpr int kPoint = 3;
constexpr int kModesRowGrain = 32;
// Of the diagonal of J_cᵀJ_c: what no factor of a landmark determines stays where it is.
constexpr double kRidges[] = {1e-12, 1e-8};
// A mode counts if the frames follow all but this share of the landmarks' motion.
constexpr double kLargestMisfit = 0.01;
constexpr int kFewestModes = 6;

double Median(std::vector<double>* values) {
  const auto middle = values->begin() + static_cast<std::ptrdiff_t>(values->size() / 2);
  std::nth_element(values->begin(), middle, values->end());
  return *middle;
}

}  // namespace

GaugeModes::GaugeModes(const Evaluator& evaluator, const std::vector<char>& is_shared,
                       Status* status)
    : evaluator_(evaluator), is_shared_(is_shared), factor_(evaluator.executor()) {
  CollectSources();
  BuildPattern();
  *status =
      are_euclidean_ ? factor_.Analyze(ReducedMatrix(pattern_, nullptr, nullptr)) : Status::Ok();
}

int GaugeModes::FrameThrough(const Linearization& cache, int factor, int slot) const {
  const int frame = evaluator_.layout().FrameOf(
      evaluator_.graph().Variables(cache.id, 0)[cache.Entry(factor) + slot]);
  return frame >= 0 && is_shared_[frame] == 0 ? frame : -1;
}

// If it is Euclidean.
int GaugeModes::LandmarkThrough(const Linearization& cache, int factor, int slot) const {
  const VariableId id = evaluator_.graph().Variables(cache.id, 0)[cache.Entry(factor) + slot];
  const int landmark = evaluator_.layout().LandmarkOf(id);
  const bool euclidean = landmark >= 0 && evaluator_.graph().AmbientSize(id) == kPoint &&
                         evaluator_.graph().manifold(id) == nullptr;
  return euclidean ? landmark : -1;
}

// The middle of the landmarks, and how far away half of them are: whatever the coordinates, modes
// are numbers of the same size.
void GaugeModes::FindCenter() {
  const FactorGraph& graph = evaluator_.graph();
  const Layout& layout = evaluator_.layout();
  const double* const state = evaluator_.points().current().data();
  std::vector<const double*> points;
  for (int l = layout.num_frames; l < static_cast<int>(layout.variables.size()); ++l) {
    const VariableId id = layout.variables[l];
    if (graph.AmbientSize(id) == kPoint && graph.manifold(id) == nullptr) {
      points.push_back(graph.ValuesIn(state, id));
    }
  }
  std::vector<double> values(points.size());
  double squared_radius = 0.0;
  for (int k = 0; k < kPoint; ++k) {
    std::transform(points.begin(), points.end(), values.begin(),
                   [k](const double* point) { return point[k]; });
    center_[k] = Median(&values);
    for (double& value : values) {
      value = std::abs(value - center_[k]);
    }
    squared_radius += std::pow(Median(&values), 2);
  }
  inverse_radius_ = squared_radius > 0.0 ? 1.0 / std::sqrt(squared_radius) : 1.0;
}

// Adds a factor to the frame's rows of R, and to the squares.
void GaugeModes::AddFactor(const Source& source, int factor, int frame, double* R,
                           double* squares) {
  const Linearization& cache = evaluator_.families()[source.family];
  const double* const point = cache.Parameters(factor)[source.landmark_slot];
  const double x = (point[0] - center_[0]) * inverse_radius_;
  const double y = (point[1] - center_[1]) * inverse_radius_;
  const double z = (point[2] - center_[2]) * inverse_radius_;
  const double w[kPoint][kStride] = {{1, 0, 0, 0, z, -y, x, 0},  // translations, rotations, scale
                                     {0, 1, 0, -z, 0, x, y, 0},
                                     {0, 0, 1, y, -x, 0, z, 0}};
  const SlotJacobians& of_point = cache.slots[source.landmark_slot];
  const SlotJacobians& of_frame = cache.slots[source.slot];
  const double* J_l = of_point.data + factor * of_point.factor_stride;
  const double* J_c = of_frame.data + factor * of_frame.factor_stride;
  bool counts_here = true;  // its first frame counts the factor
  for (int s = 0; s < source.slot; ++s) {
    counts_here = counts_here && FrameThrough(cache, factor, s) < 0;
  }
  for (int r = 0; r < cache.residual_size; ++r) {
    double moved[kStride] = {};
    for (int k = 0; k < kPoint; ++k) {
      for (int m = 0; m < kStride; ++m) {
        moved[m] += J_l[r * of_point.row_stride + k] * w[k][m];
      }
    }
    for (int m = 0; m < kStride; ++m) {
      squares[m] += counts_here ? moved[m] * moved[m] : 0.0;
    }
    for (int c = 0; c < of_frame.columns; ++c) {
      for (int m = 0; m < kStride; ++m) {
        R[c * kStride + m] -= J_c[r * of_frame.row_stride + c] * moved[m];
      }
    }
  }
  AddBlocks(source, factor, frame);
}

// And to J_cᵀJ_c.
void GaugeModes::AddBlocks(const Source& source, int factor, int frame) {
  const Linearization& cache = evaluator_.families()[source.family];
  const SlotJacobians& of_frame = cache.slots[source.slot];
  const double* const J_c = of_frame.data + factor * of_frame.factor_stride;
  for (int s = 0; s < cache.num_slots; ++s) {
    const int other = FrameThrough(cache, factor, s);
    if (other < 0 || other > frame) {
      continue;
    }
    const auto first = pattern_.columns.begin() + pattern_.row_begin[frame];
    const auto last = pattern_.columns.begin() + pattern_.row_begin[frame + 1];
    const auto block = std::lower_bound(first, last, other) - pattern_.columns.begin();
    double* const out = C_.data() + pattern_.value_begin[block];
    const SlotJacobians& of_other = cache.slots[s];
    const double* const J_o = of_other.data + factor * of_other.factor_stride;
    for (int r = 0; r < cache.residual_size; ++r) {
      for (int i = 0; i < of_frame.columns; ++i) {
        const double a = J_c[r * of_frame.row_stride + i];
        for (int j = 0; j < of_other.columns; ++j) {
          out[i * of_other.columns + j] += a * J_o[r * of_other.row_stride + j];
        }
      }
    }
  }
}

void GaugeModes::Accumulate(int begin, int end) {
  std::fill(R_.begin() + Begin(begin), R_.begin() + Begin(end), 0.0);
  std::fill(squares_.begin() + std::ptrdiff_t{begin} * kStride,
            squares_.begin() + std::ptrdiff_t{end} * kStride, 0.0);
  std::fill(C_.begin() + pattern_.value_begin[pattern_.row_begin[begin]],
            C_.begin() + pattern_.value_begin[pattern_.row_begin[end]], 0.0);
  for (int frame = begin; frame < end; ++frame) {
    for (const Source& source : sources_) {
      for (int k = source.begin[frame]; k < source.begin[frame + 1]; ++k) {
        AddFactor(source, source.factors[k], frame, R_.data() + Begin(frame),
                  squares_.data() + std::ptrdiff_t{frame} * kStride);
      }
    }
  }
}

bool GaugeModes::Factorize() {
  for (const double ridge : kRidges) {
    for (int i = 0; i < pattern_.num_blocks(); ++i) {
      const int size = pattern_.block_size(i);
      const double* const block = C_.data() + pattern_.value_begin[pattern_.row_begin[i + 1] - 1];
      for (int k = 0; k < size; ++k) {
        const double C_kk = block[k * size + k];
        diagonal_[pattern_.offsets[i] + k] = C_kk > 0.0 ? ridge * C_kk : 1.0;
      }
    }
    if (factor_.Factorize(ReducedMatrix(pattern_, C_.data(), diagonal_.data()), {}).ok()) {
      return true;
    }
  }
  return false;
}

bool GaugeModes::SolveModes() {
  const auto size = static_cast<std::size_t>(pattern_.size());
  std::vector<double> right(size), left(size);
  int num_fitting = 0;
  for (int m = 0; m < kCount; ++m) {
    double moved = 0.0, followed = 0.0;
    for (std::size_t k = m; k < squares_.size(); k += kStride) {
      moved += squares_[k];
    }
    for (std::size_t k = 0; k < size; ++k) {
      right[k] = R_[k * kStride + m];
    }
    if (!factor_.Solve(right.data(), {}, {}, left.data()).ok()) {
      return false;
    }
    for (std::size_t k = 0; k < size; ++k) {
      followed += right[k] * left[k];
    }
    misfit_[m] = moved > 0.0 ? std::max(0.0, 1.0 - followed / moved) : 1.0;
    const bool fits = misfit_[m] <= kLargestMisfit;
    num_fitting += fits ? 1 : 0;
    for (std::size_t k = 0; k < size; ++k) {
      V_[k * kStride + m] = fits ? left[k] : 0.0;
    }
  }
  return num_fitting >= kFewestModes;
}

bool GaugeModes::Compute() {
  if (!are_euclidean_) {
    return false;
  }
  FindCenter();
  evaluator_.executor().For(pattern_.num_blocks(), kModesRowGrain,
                            [this](int begin, int end) { Accumulate(begin, end); });
  return Factorize() && SolveModes();
}

std::int64_t GaugeModes::Bytes() const {
  std::int64_t bytes = static_cast<std::int64_t>(
      (C_.size() + diagonal_.size() + R_.size() + V_.size() + squares_.size()) * sizeof(double) +
      factor_.Bytes());
  for (const Source& source : sources_) {
    bytes += static_cast<std::int64_t>((source.begin.size() + source.factors.size()) * sizeof(int));
  }
  return bytes;
}

}  // namespace inceres::internal
