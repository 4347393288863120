#include "schur/mode_columns.h"

#include <algorithm>
#include <map>

namespace inceres::internal {

// Without gauge modes frames of the same size share columns: those of another size have others.
ModeColumns::ModeColumns(const FrameAggregates& aggregates, const std::vector<int>& offsets,
                         bool by_gauge)
    : is_shared_(aggregates.is_shared), widths_(aggregates.count, by_gauge ? kGaugeModes : 0) {
  std::vector<std::map<int, int>> column_of_size(aggregates.count);
  for (std::size_t i = 0; i < is_shared_.size(); ++i) {
    const int aggregate = aggregates.clusters.cluster_of[i];
    const int size = offsets[i + 1] - offsets[i];
    constant_column_.push_back(0);
    if (is_shared_[i] != 0) {
      widths_[aggregate] = size;
    } else if (!by_gauge) {
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
    if (modes != nullptr && is_shared_[i] == 0) {
      std::copy_n(modes->Of(i), size * stride, V);
      continue;
    }
    std::fill_n(V, size * stride, 0.0);
    const int width = columns->shape().widths[aggregate];
    for (int k = 0; k < size && constant_column_[i] + k < width; ++k) {
      V[k * stride + constant_column_[i] + k] = 1.0;
    }
  }
}

}  // namespace inceres::internal
