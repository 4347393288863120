#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include "inceres/graph/factor_family.h"

namespace inceres {

/// Writes J_tangent (num_rows × map.tangent_size, rows row_stride apart) = J_ambient (row-major, contiguous) · M.
/// Does nothing where no Jacobian is wanted. Cost: a copy for identity and selection maps.
INCERES_EXPORT void ProjectToTangentSpace(const TangentMap& map, const double* J_ambient, int num_rows, double* J_tangent,
                                          int row_stride);

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
  static constexpr double kImpossible = 1e302;

  // Ambient Jacobians of one factor. Up to kInline doubles live on the stack: small factors allocate nothing.
  struct Scratch {
    static constexpr std::size_t kInline = 512;
    static constexpr std::size_t kInlineSlots = 16;

    explicit Scratch(const FactorFamily& family) {
      std::size_t size = 0;
      for (int s = 0; s < family.num_slots(); ++s) {
        size += static_cast<std::size_t>(family.residual_size()) * static_cast<std::size_t>(family.slot(s).ambient_size);
      }
      const auto num_slots = static_cast<std::size_t>(family.num_slots());
      if (size > kInline) {
        heap.resize(size);
      }
      if (num_slots > kInlineSlots) {
        heap_pointers.resize(2 * num_slots);
      }
      double* next = size > kInline ? heap.data() : stack;
      blocks = num_slots > kInlineSlots ? heap_pointers.data() : stack_pointers;
      requested = blocks + num_slots;
      for (int s = 0; s < family.num_slots(); ++s) {
        blocks[s] = next;
        next += family.residual_size() * family.slot(s).ambient_size;
      }
    }
    Scratch(const Scratch&) = delete;
    Scratch& operator=(const Scratch&) = delete;

    double stack[kInline];
    double* stack_pointers[2 * kInlineSlots];
    std::vector<double> heap;
    std::vector<double*> heap_pointers;
    double** blocks;     // where the ambient Jacobian of each slot goes
    double** requested;  // the same, null for constants: what the user's code sees
  };

  static void Fill(double* values, int count) {
    for (int k = 0; k < count; ++k) {
      values[k] = kImpossible;
    }
  }

  static bool IsValid(const double* values, int count) {
    // Almost every entry is ordinary: one comparison each, in whole vectors. NaN fails it too.
    std::int64_t ordinary = -1;
    for (int k = 0; k < count; ++k) {
      ordinary &= -static_cast<std::int64_t>(std::fabs(values[k]) < 1e300);
    }
    if (ordinary != 0) {
      return true;
    }
    for (int k = 0; k < count; ++k) {
      if (!std::isfinite(values[k]) || values[k] == kImpossible) {
        return false;
      }
    }
    return true;
  }

  EvaluationFailure EvaluateAndProject(int i, const FactorBatch& batch, Scratch& scratch) const {
    const Derived& derived = static_cast<const Derived&>(*this);
    const std::ptrdiff_t first_slot = static_cast<std::ptrdiff_t>(i) * num_slots();
    const double* const* parameters = batch.parameters + first_slot;
    double* residuals = batch.residuals + static_cast<std::ptrdiff_t>(i) * residual_size();
    Fill(residuals, residual_size());
    if (batch.jacobians == nullptr) {
      if (!derived.EvaluateOne(i, parameters, residuals, nullptr)) {
        return {i, "the cost function returned false"};
      }
      return IsValid(residuals, residual_size()) ? EvaluationFailure{}
                                                 : EvaluationFailure{i, "a residual is not finite or was not written"};
    }
    const TangentMap* const* maps = batch.tangent_maps + first_slot;
    // What is unwanted is asked for all the same: code that never met a constant may not look for a null pointer.
    for (int s = 0; s < num_slots(); ++s) {
      const bool constant = maps[s]->kind == TangentMap::Kind::kConstant;
      scratch.requested[s] = constant ? nullptr : scratch.blocks[s];
      if (!constant) {
        Fill(scratch.blocks[s], residual_size() * slot(s).ambient_size);
      }
    }
    if (!derived.EvaluateOne(i, parameters, residuals, scratch.requested)) {
      return {i, "the cost function returned false"};
    }
    if (!IsValid(residuals, residual_size())) {
      return {i, "a residual is not finite or was not written"};
    }
    for (int s = 0; s < num_slots(); ++s) {
      if (!maps[s]->wanted()) {
        continue;
      }
      if (!IsValid(scratch.blocks[s], residual_size() * slot(s).ambient_size)) {
        return {i, "a Jacobian entry is not finite or was not written"};
      }
      const JacobianView& view = batch.jacobians[s];
      ProjectToTangentSpace(*maps[s], scratch.blocks[s], residual_size(), view.data + i * view.factor_stride, view.row_stride);
    }
    return {};
  }
};

}  // namespace inceres
