#include "schur/gauge_modes.h"

#include <algorithm>
#include <map>
#include <utility>

namespace inceres::internal {

// The modes v of frames that go with a motion w of the landmarks as one: the least-squares solution
// of J_c v = −J_l w (docs/algorithms.md, "Reduced linear systems"). By normal equations, C v = R
// with C = J_cᵀJ_c and R = −J_cᵀJ_l w, of which GaugeNormals makes the sums: a preconditioner may
// be wrong in the last digits, and C is as sparse as the factors between frames are few.
//
// The misfit comes without another pass over J. At the solution vᵀC v = vᵀR, hence
//     ‖J_c v + J_l w‖² = ‖J_l w‖² + vᵀC v − 2 vᵀR = ‖J_l w‖² − vᵀR.

namespace {

// Of the diagonal of J_cᵀJ_c: what no factor of a landmark determines stays where it is.
constexpr double kRidges[] = {1e-12, 1e-8};
// A mode counts if the frames follow all but this share of the landmarks' motion.
constexpr double kLargestMisfit = 0.01;
// The scale may be known; who cannot follow a translation or a rotation does not measure Euclidean
// points.
constexpr int kFewestModes = 6;

}  // namespace

GaugeFit::GaugeFit(BlockPattern pattern, const Executor& executor, Status* status)
    : pattern_(std::move(pattern)), factor_(executor) {
  const auto size = static_cast<std::size_t>(pattern_.size());
  diagonal_.resize(size);
  V_.resize(size * kGaugeStride);
  *status = factor_.Analyze(ReducedMatrix(pattern_, nullptr, nullptr));
}

bool GaugeFit::Factorize(const std::vector<double>& C) {
  // The smaller ridge first. It is relative to each diagonal entry, so it does not depend on units.
  for (const double ridge : kRidges) {
    for (int i = 0; i < pattern_.num_blocks(); ++i) {
      const int size = pattern_.block_size(i);
      const double* const block = C.data() + pattern_.value_begin[pattern_.row_begin[i + 1] - 1];
      for (int k = 0; k < size; ++k) {
        // A parameter that no such factor touches gets a one of its own, and with a zero on the
        // right its mode is zero. So do all parameters of a shared frame.
        const double C_kk = block[k * size + k];
        diagonal_[pattern_.offsets[i] + k] = C_kk > 0.0 ? ridge * C_kk : 1.0;
      }
    }
    if (factor_.Factorize(ReducedMatrix(pattern_, C.data(), diagonal_.data()), {}).ok()) {
      return true;
    }
  }
  return false;
}

// Seven right-hand sides with one factor. All are solved for, also when some do not fit: misfit()
// tells of each.
bool GaugeFit::SolveModes(const GaugeSums& sums) {
  const auto size = static_cast<std::size_t>(pattern_.size());
  std::vector<double> right(size), left(size);
  int num_fitting = 0;
  for (int m = 0; m < kGaugeModes; ++m) {
    double moved = 0.0, followed = 0.0;
    // Per frame; summed here in the order of the frames, whatever the tasks were.
    for (std::size_t k = m; k < sums.squares.size(); k += kGaugeStride) {
      moved += sums.squares[k];
    }
    for (std::size_t k = 0; k < size; ++k) {
      right[k] = sums.R[k * kGaugeStride + m];
    }
    if (!factor_.Solve(right.data(), {}, {}, left.data()).ok()) {
      return false;
    }
    for (std::size_t k = 0; k < size; ++k) {
      followed += right[k] * left[k];
    }
    // A difference of nearly equal numbers where the frames follow well: rounding may leave it
    // below zero. A motion that no factor feels cannot be judged and counts as not followed.
    misfit_[m] = moved > 0.0 ? std::max(0.0, 1.0 - followed / moved) : 1.0;
    const bool fits = misfit_[m] <= kLargestMisfit;
    num_fitting += fits ? 1 : 0;
    for (std::size_t k = 0; k < size; ++k) {
      // Column m stays where it is: widths are settled, and a column of zeros is one that
      // Orthonormalize leaves zero.
      V_[k * kGaugeStride + m] = fits ? left[k] : 0.0;
    }
  }
  return num_fitting >= kFewestModes;
}

bool GaugeFit::Solve(const GaugeSums& sums) {
  return Factorize(sums.C) && SolveModes(sums);
}

std::int64_t GaugeFit::Bytes() const {
  return static_cast<std::int64_t>((diagonal_.size() + V_.size()) * sizeof(double) +
                                   factor_.Bytes());
}

GaugeModes::GaugeModes(const Evaluator& evaluator, const std::vector<char>& is_shared,
                       Status* status)
    : normals_(evaluator, is_shared),
      are_euclidean_(2.0 * normals_.num_of_points() > normals_.num_of_landmarks()),
      sums_(normals_.pattern()),
      fit_(normals_.pattern(), evaluator.executor(), status) {
}

// About where the points are now: the origin moves with them, the modes of a frame change with J.
bool GaugeModes::Compute() {
  if (!are_euclidean_) {
    return false;
  }
  normals_.Accumulate(normals_.FindOrigin(), &sums_);
  return fit_.Solve(sums_);
}

// V of the coarse space, column by column (docs/algorithms.md, "Reduced linear systems"). Widths
// are fixed with the structure and the columns written at each linearization: modes that fit at one
// point may not fit at the next, and what then takes their place must find room within the same
// widths.
//
// The stand-in for modes is piecewise constant: each parameter of a frame has a column that is one
// in this parameter of all frames of the aggregate.

// Without gauge modes frames of the same size share columns: those of another size have others.
ModeColumns::ModeColumns(const FrameAggregates& aggregates, const std::vector<int>& offsets,
                         bool by_gauge)
    // By gauge all aggregates but those of shared frames are seven wide.
    : is_shared_(aggregates.is_shared), widths_(aggregates.count, by_gauge ? kGaugeModes : 0) {
  std::vector<std::map<int, int>> column_of_size(aggregates.count);
  for (std::size_t i = 0; i < is_shared_.size(); ++i) {
    const int aggregate = aggregates.clusters.cluster_of[i];
    const int size = offsets[i + 1] - offsets[i];
    constant_column_.push_back(0);
    if (is_shared_[i] != 0) {
      // Alone in its aggregate: its columns span all that it can do.
      widths_[aggregate] = size;
    } else if (!by_gauge) {
      // Poses and biases in one aggregate, say: parameters of frames of different sizes have
      // nothing in common.
      const auto [found, is_new] = column_of_size[aggregate].emplace(size, widths_[aggregate]);
      widths_[aggregate] += is_new ? size : 0;
      constant_column_[i] = found->second;
    }
  }
}

void ModeColumns::Write(const GaugeFit* modes, CoarseColumns* columns) const {
  for (int i = 0; i < columns->num_rows(); ++i) {
    const int aggregate = columns->shape().aggregate_of[i];
    const int stride = columns->stride(aggregate);
    const int size = columns->block_size(i);
    double* const V = columns->V(i);
    // The stride of seven columns is kGaugeStride: rows of modes are copied as they are, with their
    // padding.
    if (modes != nullptr && is_shared_[i] == 0) {
      // Zeros for a mode that does not fit.
      std::copy_n(modes->Of(i), size * stride, V);
      continue;
    }
    std::fill_n(V, size * stride, 0.0);
    const int width = columns->shape().widths[aggregate];
    // In place of modes there is room for the first seven parameters only.
    for (int k = 0; k < size && constant_column_[i] + k < width; ++k) {
      V[k * stride + constant_column_[i] + k] = 1.0;
    }
  }
}

}  // namespace inceres::internal
