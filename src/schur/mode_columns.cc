#include "schur/mode_columns.h"

#include <algorithm>
#include <map>

namespace inceres::internal {

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
