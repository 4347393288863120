#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <memory>
#include <vector>

#include "inceres/graph/factor_family.h"

namespace inceres {

namespace internal {

template <int kCount>
void CopyColumnsOf(int ambient_size, const double* J_ambient, int num_rows, double* J_tangent, int row_stride) {
  for (int r = 0; r < num_rows; ++r, J_ambient += ambient_size, J_tangent += row_stride) {
    std::memcpy(J_tangent, J_ambient, kCount * sizeof(double));
  }
}

/// The product with M = [I; 0]: the first `count` columns as they are. The usual sizes need no call.
inline void CopyColumns(int count, int ambient_size, const double* J_ambient, int num_rows, double* J_tangent, int row_stride) {
  switch (count) {
    case 1:
      return CopyColumnsOf<1>(ambient_size, J_ambient, num_rows, J_tangent, row_stride);
    case 3:
      return CopyColumnsOf<3>(ambient_size, J_ambient, num_rows, J_tangent, row_stride);
    case 6:
      return CopyColumnsOf<6>(ambient_size, J_ambient, num_rows, J_tangent, row_stride);
    case 9:
      return CopyColumnsOf<9>(ambient_size, J_ambient, num_rows, J_tangent, row_stride);
    default:
      break;
  }
  for (int r = 0; r < num_rows; ++r, J_ambient += ambient_size, J_tangent += row_stride) {
    std::copy_n(J_ambient, count, J_tangent);
  }
}

}  // namespace internal

/// Writes J_tangent (num_rows × map.tangent_size, rows row_stride apart) = J_ambient (row-major, contiguous) · M.
/// Does nothing where no Jacobian is wanted. Cost: a copy for identity and selection maps.
INCERES_EXPORT void ProjectToTangentSpace(const TangentMap& map, const double* J_ambient, int num_rows, double* J_tangent,
                                          int row_stride);

/// What entries nobody has written yet hold.
constexpr double kUnwritten = 1e302;

/// Fills `values` with kUnwritten, so that AreWritten finds what was forgotten.
inline void MarkUnwritten(double* values, int count) {
  for (int k = 0; k < count; ++k) {
    values[k] = kUnwritten;
  }
}

/// Whether every entry is finite and has been written since MarkUnwritten.
INCERES_EXPORT bool AreAllWritten(const double* values, int count);

/// The same; a few ordinary entries, as most residuals are, need no call.
inline bool AreWritten(const double* values, int count) {
  double sum = 0.0;
  for (int k = 0; k < count && count <= 4; ++k) {
    sum += std::fabs(values[k]);
  }
  return (count <= 4 && sum < 0.01 * kUnwritten) || AreAllWritten(values, count);
}

/// A family of factors given one at a time with ambient Jacobians, as a user of Ceres writes them. Derived supplies
///
///     bool EvaluateOne(int i, const double* const* parameters, double* residuals, double** jacobians) const;
///
/// with Ceres's conventions: `jacobians` is null for a cost-only call; jacobians[s] is null for a constant, otherwise
/// row-major residual_size × ambient_size; false means "cannot be evaluated here". Outputs are filled beforehand with an
/// impossible value and checked afterwards, so a forgotten entry, a NaN or an infinity is reported with the factor's index.
/// Source: the obligations of ceres::CostFunction::Evaluate (Ceres 2.1, residual_block.cc).
template <typename Derived>
class AmbientFamily : public FactorFamily {
 public:
  using FactorFamily::FactorFamily;

  EvaluationFailure Evaluate(const FactorBatch& batch) const override {
    Scratch scratch(*this);
    for (int i = batch.begin; i < batch.end; ++i) {
      const EvaluationFailure failure = EvaluateAndProject(i, batch, scratch);
      if (failure.failed()) {
        return failure;
      }
    }
    return {};
  }

 private:
  // Ambient Jacobians of one factor, those of its variables one after the other. Up to kInline doubles live on the stack: small
  // factors allocate nothing.
  struct Scratch {
    static constexpr std::size_t kInline = 512;
    static constexpr std::size_t kInlineSlots = 16;

    explicit Scratch(const FactorFamily& family) {
      std::size_t size = 0;
      for (int s = 0; s < family.num_slots(); ++s) {
        size += static_cast<std::size_t>(family.residual_size()) * static_cast<std::size_t>(family.slot(s).ambient_size);
      }
      if (size > kInline) {
        heap.reset(new double[size]);  // not make_unique: it is filled before every use
        values = heap.get();
      }
      const auto num_slots = static_cast<std::size_t>(family.num_slots());
      if (num_slots > kInlineSlots) {
        heap_blocks.resize(num_slots);
        blocks = heap_blocks.data();
      }
    }
    Scratch(const Scratch&) = delete;
    Scratch& operator=(const Scratch&) = delete;

    // Points each slot to its place, constants to null, and returns how many doubles that makes.
    int Arrange(const FactorFamily& family, const TangentMap* const* maps) {
      const int rows = family.residual_size();
      int size = 0;
      for (int s = 0; s < family.num_slots(); ++s) {
        // What is unwanted is asked for all the same: code that never met a constant may not look for a null pointer.
        const bool constant = maps[s]->kind == TangentMap::Kind::kConstant;
        blocks[s] = constant ? nullptr : values + size;
        size += constant ? 0 : rows * family.slot(s).ambient_size;
      }
      return size;
    }

    double stack[kInline];
    double* stack_blocks[kInlineSlots];
    std::unique_ptr<double[]> heap;
    std::vector<double*> heap_blocks;
    double* values = stack;
    double** blocks = stack_blocks;  // what the user's code sees
  };

  EvaluationFailure EvaluateAndProject(int i, const FactorBatch& batch, Scratch& scratch) const {
    const Derived& derived = static_cast<const Derived&>(*this);
    const int rows = residual_size();
    const std::ptrdiff_t first_slot = static_cast<std::ptrdiff_t>(i) * num_slots();
    const double* const* parameters = batch.parameters + first_slot;
    double* residuals = batch.residuals + static_cast<std::ptrdiff_t>(i) * rows;
    const TangentMap* const* maps = batch.jacobians == nullptr ? nullptr : batch.tangent_maps + first_slot;
    const int jacobian_size = maps == nullptr ? 0 : scratch.Arrange(*this, maps);
    MarkUnwritten(residuals, rows);
    MarkUnwritten(scratch.values, jacobian_size);
    if (!derived.EvaluateOne(i, parameters, residuals, maps == nullptr ? nullptr : scratch.blocks)) {
      return {i, "the cost function returned false"};
    }
    if (!AreWritten(residuals, rows)) {
      return {i, "a residual is not finite or was not written"};
    }
    if (maps == nullptr) {
      return {};
    }
    const bool all_written = AreWritten(scratch.values, jacobian_size);
    for (int s = 0; s < num_slots(); ++s) {
      if (!maps[s]->wanted()) {
        continue;
      }
      if (!all_written && !AreWritten(scratch.blocks[s], rows * slot(s).ambient_size)) {
        return {i, "a Jacobian entry is not finite or was not written"};
      }
      const JacobianView& view = batch.jacobians[s];
      double* J_tangent = view.data + i * view.factor_stride;
      if (maps[s]->copies()) {  // as most are: without a call
        internal::CopyColumns(maps[s]->tangent_size, maps[s]->ambient_size, scratch.blocks[s], rows, J_tangent, view.row_stride);
      } else {
        ProjectToTangentSpace(*maps[s], scratch.blocks[s], rows, J_tangent, view.row_stride);
      }
    }
    return {};
  }
};

}  // namespace inceres
