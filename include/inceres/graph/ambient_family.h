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

/// Copies the first `columns` of an ambient Jacobian (num_rows × ambient_size, contiguous) to rows row_stride apart and returns
/// the sum of the magnitudes of all its entries: one pass is the product with M = [I; 0] and the proof that the entries are
/// ordinary.
using CopyFunction = double (*)(int ambient_size, int columns, const double* J_ambient, int num_rows, double* J_tangent,
                                int row_stride);

/// The fastest for the sizes.
INCERES_EXPORT CopyFunction FindCopy(int ambient_size, int columns);

}  // namespace internal

/// Writes J_tangent (num_rows × map.tangent_size, rows row_stride apart) = J_ambient (row-major, contiguous) · M.
/// Does nothing where no Jacobian is wanted. Cost: a copy for identity and selection maps.
INCERES_EXPORT void ProjectToTangentSpace(const TangentMap& map, const double* J_ambient, int num_rows, double* J_tangent,
                                          int row_stride);

/// What entries nobody has written yet hold.
constexpr double kUnwritten = 1e302;

/// Fills `values` with kUnwritten, so that AreWritten finds what was forgotten.
inline void MarkUnwritten(double* values, int count) {
  for (; count > 3; count -= 4, values += 4) {
    for (int k = 0; k < 4; ++k) {
      values[k] = kUnwritten;
    }
  }
  if (count > 0) {  // one to three, as most are to begin with: without a loop
    values[0] = kUnwritten;
    if (count > 1) {
      values[1] = kUnwritten;
      if (count > 2) {
        values[2] = kUnwritten;
      }
    }
  }
}

/// Whether a sum of magnitudes proves that each of them is finite and has been written. It need not: a finite one may be larger.
inline bool AreOrdinary(double sum_of_magnitudes) {
  return sum_of_magnitudes < 0.01 * kUnwritten;
}

/// Whether every entry is finite and has been written since MarkUnwritten.
INCERES_EXPORT bool AreAllWritten(const double* values, int count);

/// The same; up to three ordinary entries, as most residuals are, need neither call nor loop.
inline bool AreWritten(const double* values, int count) {
  if (count > 0 && count <= 3) {
    double sum = std::fabs(values[0]);
    if (count > 1) {
      sum += std::fabs(values[1]);
      if (count > 2) {
        sum += std::fabs(values[2]);
      }
    }
    if (AreOrdinary(sum)) {
      return true;
    }
  }
  return AreAllWritten(values, count);
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
    return batch.jacobians == nullptr ? EvaluateResiduals(batch) : EvaluateAndProject(batch);
  }

 private:
  // Ambient Jacobians of one factor, those of its variables one after the other, and what to do with each. Up to kInline doubles
  // live on the stack: small factors allocate nothing.
  struct Scratch {
    static constexpr std::size_t kInline = 512;
    static constexpr std::size_t kInlineSlots = 16;
    struct Slot {
      int size;
      internal::CopyFunction copy;
      bool is_row;  // ambient and tangent Jacobian are one row of the same size
    };

    explicit Scratch(const FactorFamily& family) : num_slots(family.num_slots()) {
      const auto count = static_cast<std::size_t>(num_slots);
      if (count > kInlineSlots) {
        heap_blocks.resize(count);
        heap_slots.resize(count);
        blocks = heap_blocks.data();
        slots = heap_slots.data();
      }
      std::size_t size = 0;
      for (int s = 0; s < num_slots; ++s) {
        const FactorFamily::Slot& slot = family.slot(s);
        slots[s] = {family.residual_size() * slot.ambient_size, internal::FindCopy(slot.ambient_size, slot.tangent_size),
                    family.residual_size() == 1 && slot.ambient_size == slot.tangent_size};
        size += static_cast<std::size_t>(slots[s].size);
      }
      if (size > kInline) {
        heap.reset(new double[size]);  // not make_unique: it is filled before every use
        values = heap.get();
      }
    }
    Scratch(const Scratch&) = delete;
    Scratch& operator=(const Scratch&) = delete;

    // Points each slot to where its ambient Jacobian goes and marks that as unwritten. What is the tangent one goes to its place.
    void Prepare(int i, const TangentMap* const* maps, const JacobianView* views) {
      int size = 0;
      for (int s = 0; s < num_slots; ++s) {
        const TangentMap::Kind kind = maps[s]->kind;
        if (kind == TangentMap::Kind::kIdentity && slots[s].is_row) {
          blocks[s] = views[s].data + i * views[s].factor_stride;
          MarkUnwritten(blocks[s], slots[s].size);
        } else {
          // What is unwanted is asked for all the same: code that never met a constant may not look for a null pointer.
          const bool constant = kind == TangentMap::Kind::kConstant;
          blocks[s] = constant ? nullptr : values + size;
          size += constant ? 0 : slots[s].size;
        }
      }
      MarkUnwritten(values, size);
    }

    // Whether all that is wanted has been written and is finite.
    bool IsWritten(const TangentMap* const* maps) const {
      bool written = true;
      for (int s = 0; s < num_slots; ++s) {
        written = written && (!maps[s]->wanted() || AreAllWritten(blocks[s], slots[s].size));
      }
      return written;
    }

    int num_slots;
    double stack[kInline];
    double* stack_blocks[kInlineSlots];
    Slot stack_slots[kInlineSlots];
    std::unique_ptr<double[]> heap;
    std::vector<double*> heap_blocks;
    std::vector<Slot> heap_slots;
    double* values = stack;
    double** blocks = stack_blocks;  // what the user's code sees
    Slot* slots = stack_slots;
  };

  EvaluationFailure EvaluateResiduals(const FactorBatch& batch) const {
    const std::ptrdiff_t rows = residual_size();
    const std::ptrdiff_t slots = num_slots();
    for (std::ptrdiff_t i = batch.begin; i < batch.end; ++i) {
      const auto factor = static_cast<int>(i);
      if (const char* fault = EvaluateChecked(factor, batch.parameters + i * slots, batch.residuals + i * rows, nullptr)) {
        return {factor, fault};
      }
    }
    return {};
  }

  EvaluationFailure EvaluateAndProject(const FactorBatch& batch) const {
    const std::ptrdiff_t rows = residual_size();
    const std::ptrdiff_t slots = num_slots();
    Scratch scratch(*this);
    for (std::ptrdiff_t i = batch.begin; i < batch.end; ++i) {
      const auto factor = static_cast<int>(i);
      const TangentMap* const* maps = batch.tangent_maps + i * slots;
      scratch.Prepare(factor, maps, batch.jacobians);
      const double* const* parameters = batch.parameters + i * slots;
      const char* fault = EvaluateChecked(factor, parameters, batch.residuals + i * rows, scratch.blocks);
      if (fault == nullptr && !Project(factor, maps, scratch, batch.jacobians)) {
        fault = "a Jacobian entry is not finite or was not written";
      }
      if (fault != nullptr) {
        return {factor, fault};
      }
    }
    return {};
  }

  // Null, or what is wrong.
  const char* EvaluateChecked(int i, const double* const* parameters, double* residuals, double** jacobians) const {
    MarkUnwritten(residuals, residual_size());
    if (!static_cast<const Derived&>(*this).EvaluateOne(i, parameters, residuals, jacobians)) {
      return "the cost function returned false";
    }
    return AreWritten(residuals, residual_size()) ? nullptr : "a residual is not finite or was not written";
  }

  // False if an entry of a Jacobian that is wanted is not finite or was not written.
  bool Project(int i, const TangentMap* const* maps, const Scratch& scratch, const JacobianView* views) const {
    double sum = 0.0;
    for (int s = 0; s < scratch.num_slots; ++s) {
      const TangentMap& map = *maps[s];
      const double* J_ambient = scratch.blocks[s];
      double* J_tangent = views[s].data + i * views[s].factor_stride;
      if (map.copies() && J_ambient == J_tangent) {
        sum += AreWritten(J_tangent, scratch.slots[s].size) ? 0.0 : kUnwritten;
      } else if (map.copies()) {  // as most do
        sum +=
            scratch.slots[s].copy(map.ambient_size, map.tangent_size, J_ambient, residual_size(), J_tangent, views[s].row_stride);
      } else if (map.wanted()) {
        ProjectToTangentSpace(map, J_ambient, residual_size(), J_tangent, views[s].row_stride);
        sum += AreAllWritten(J_ambient, scratch.slots[s].size) ? 0.0 : kUnwritten;
      }
    }
    return AreOrdinary(sum) || scratch.IsWritten(maps);
  }
};

}  // namespace inceres
