#include "schur/live_schur.h"

#include <algorithm>
#include <cmath>

#include "schur/landmark_factor.h"

namespace inceres::internal {
namespace {

// A landmark whose block is this singular against its own scale carries no information (algorithms.md section 3, parked
// landmarks).
constexpr double kNoInformation = 1e-12;

}  // namespace

int LiveSchur::AddFrame(VariableId id, std::int32_t quad, int size) {
  frames_.push_back({id, quad, size, {}});
  offsets_.push_back(offsets_.back() + size);
  b_.resize(offsets_.back(), 0.0);
  C_diagonal_.resize(offsets_.back(), 0.0);
  return S_.AddRow(size);
}

int LiveSchur::AddLandmark(VariableId id, std::int32_t quad, int size) {
  Landmark& landmark = landmarks_.emplace_back();
  landmark.id = id;
  landmark.quad = quad;
  landmark.size = size;
  return static_cast<int>(landmarks_.size()) - 1;
}

void LiveSchur::Connect(FactorRef ref, const std::int32_t* frames, std::int32_t landmark) {
  const int num_slots = families_[ref.family].num_slots();
  frame_of_slot_.resize(families_.size());
  landmark_of_.resize(families_.size());
  landmark_slot_.resize(families_.size());
  frame_of_slot_[ref.family].insert(frame_of_slot_[ref.family].end(), frames, frames + num_slots);
  landmark_of_[ref.family].push_back(landmark);
  const VariableId* variables = families_[ref.family].variables(ref.factor);
  const auto is_landmark = [&](VariableId id) { return landmark >= 0 && id == landmarks_[landmark].id; };
  landmark_slot_[ref.family].push_back(
      static_cast<std::int32_t>(std::find_if(variables, variables + num_slots, is_landmark) - variables));
  for (int s = 0; s < num_slots; ++s) {
    if (frames[s] >= 0) {
      frames_[frames[s]].factors.push_back(ref);
    }
  }
  if (landmark < 0) {
    return;
  }
  Landmark& l = landmarks_[landmark];
  l.factors.push_back(ref);
  for (int s = 0; s < num_slots; ++s) {
    if (frames[s] >= 0 && std::find(l.frames.begin(), l.frames.end(), frames[s]) == l.frames.end()) {
      l.frames.push_back(frames[s]);
    }
  }
}

void LiveSchur::AddFactor(FactorRef ref, double sign) {
  const LiveFamily& family = families_[ref.family];
  const int depth = family.residual_size();
  const double* q = family.q(ref.factor);
  for (int r = 0; r < family.num_slots(); ++r) {
    const std::int32_t row = FrameOfFactor(ref, r);
    if (row < 0) {
      continue;
    }
    const double* J_r = family.Jacobian(ref.factor, r);
    const int size = frames_[row].size;
    const int stride = PadToQuad(size);
    for (int c = 0; c < family.num_slots(); ++c) {
      const std::int32_t column = FrameOfFactor(ref, c);
      if (column < 0 || column > row) {
        continue;
      }
      const ProductTerm term{0, 0};
      BlockProducts products;
      products.a = family.Jacobian(ref.factor, c);
      products.b = J_r;
      products.terms = &term;
      products.count = 1;
      products.depth = depth;
      products.a_size = frames_[column].size;
      products.b_size = size;
      kernels_.accumulate_products(products, sign, S_.values(S_.FindOrAdd(row, column)));
    }
    for (int k = 0; k < size; ++k) {
      double gradient = 0.0;
      double squared = 0.0;
      for (int i = 0; i < depth; ++i) {
        const double entry = J_r[i * stride + k];
        gradient += entry * q[i];
        squared += entry * entry;
      }
      b_[offsets_[row] + k] -= sign * gradient;
      C_diagonal_[offsets_[row] + k] += sign * squared;
    }
    Touch(row);
  }
}

void LiveSchur::ChangeResidual(FactorRef ref, const double* q_change) {
  const LiveFamily& family = families_[ref.family];
  for (int s = 0; s < family.num_slots(); ++s) {
    const std::int32_t row = FrameOfFactor(ref, s);
    if (row < 0) {
      continue;
    }
    const double* J = family.Jacobian(ref.factor, s);
    const int stride = PadToQuad(frames_[row].size);
    for (int k = 0; k < frames_[row].size; ++k) {
      double change = 0.0;
      for (int i = 0; i < family.residual_size(); ++i) {
        change += J[i * stride + k] * q_change[i];
      }
      b_[offsets_[row] + k] -= change;
    }
  }
}

// New factors may have brought new frames since: the contribution is that of the incidences, the frames it went in with.
void LiveSchur::AddToS(const Landmark& landmark, double sign) {
  for (std::size_t r = 0; r < landmark.incidences.size(); ++r) {
    const std::int32_t row = landmark.frames[r];
    for (std::size_t c = 0; c < landmark.incidences.size(); ++c) {
      const std::int32_t column = landmark.frames[c];
      if (column > row) {
        continue;
      }
      const ProductTerm term{landmark.incidences[c].y, landmark.incidences[r].y};
      BlockProducts products;
      products.a = products.b = Y_.data();
      products.terms = &term;
      products.count = 1;
      products.depth = landmark.size;
      products.a_size = frames_[column].size;
      products.b_size = frames_[row].size;
      kernels_.accumulate_products(products, sign, S_.values(S_.FindOrAdd(row, column)));
    }
    Touch(row);
  }
}

void LiveSchur::AddToB(const Landmark& landmark, const double* z, double sign) {
  for (std::size_t r = 0; r < landmark.incidences.size(); ++r) {
    const Incidence& incidence = landmark.incidences[r];
    const double* Y = Y_.data() + static_cast<std::ptrdiff_t>(incidence.y) * kQuad;
    double* b = b_.data() + offsets_[landmark.frames[r]];
    const int size = frames_[landmark.frames[r]].size;
    for (int k = 0; k < landmark.size; ++k) {
      for (int i = 0; i < size; ++i) {
        b[i] += sign * Y[k * incidence.quads * kQuad + i] * z[k];
      }
    }
  }
}

void LiveSchur::TakeOut(std::int32_t landmark) {
  Landmark& l = landmarks_[landmark];
  if (l.in_S) {
    AddToS(l, 1.0);
    AddToB(l, l.z, 1.0);
    l.in_S = false;
  }
  l.decrement = 0.0;
}

void LiveSchur::PutIn(std::int32_t landmark, double lambda) {
  Landmark& l = landmarks_[landmark];
  l.lambda = lambda;
  SumLandmark(&l);
  double damping[4];
  double largest = 0.0;
  for (int k = 0; k < l.size; ++k) {
    damping[k] = lambda * l.P[k * kQuad + k];
    largest = std::max(largest, l.P[k * kQuad + k]);
  }
  l.parked = !(largest > 0.0) || !InvertCholeskyFactor(l.size, l.P, damping, l.U_inv);
  for (int k = 0; k < l.size && !l.parked; ++k) {
    // 1/U_inv² is the pivot: what the other coordinates leave of the diagonal entry.
    const double pivot = 1.0 / (l.U_inv[k * kQuad + k] * l.U_inv[k * kQuad + k]);
    l.parked = pivot < kNoInformation * largest;
  }
  if (l.parked) {
    return;
  }
  PlaceBlocks(landmark);
  EliminateLandmark(&l);
  AddToS(l, -1.0);
  AddToB(l, l.z, -1.0);
  l.in_S = true;
}

void LiveSchur::RefreshResidual(std::int32_t landmark) {
  Landmark& l = landmarks_[landmark];
  if (!l.in_S) {
    return;
  }
  double old_z[kQuad];
  std::copy_n(l.z, kQuad, old_z);
  SumLandmark(&l);
  MultiplyLower(l.size, l.U_inv, l.eta, l.z);
  double change[kQuad];
  double decrement = 0.0;
  for (int k = 0; k < l.size; ++k) {
    change[k] = l.z[k] - old_z[k];
    decrement += 0.5 * l.z[k] * l.z[k];
  }
  AddToB(l, change, -1.0);
  l.decrement = decrement;
}

void LiveSchur::PlaceBlocks(std::int32_t landmark) {
  Landmark& l = landmarks_[landmark];
  if (l.num_placed == l.factors.size()) {
    return;
  }
  l.num_placed = l.factors.size();
  if (l.y_quads > 0) {
    ReleaseY(l.incidences.front().y, l.y_quads);
  }
  l.incidences.clear();
  l.y_quads = 0;
  for (const std::int32_t frame : l.frames) {
    const auto quads = static_cast<std::int32_t>(PadToQuad(frames_[frame].size) / kQuad);
    l.incidences.push_back({l.y_quads, frames_[frame].quad, quads});
    l.y_quads += quads * l.size;
  }
  const std::int32_t base = AllocateY(l.y_quads);
  for (Incidence& incidence : l.incidences) {
    incidence.y += base;
  }
  // The first factor that reaches a block sets it, later ones add to it.
  std::vector<char> begun(l.frames.size(), 0);
  for (const FactorRef& ref : l.factors) {
    std::int32_t* targets = families_[ref.family].y_targets() + Slot(ref, 0);
    for (int s = 0; s < families_[ref.family].num_slots(); ++s) {
      const std::int32_t frame = FrameOfFactor(ref, s);
      if (frame < 0) {
        continue;
      }
      const auto at = std::find(l.frames.begin(), l.frames.end(), frame) - l.frames.begin();
      targets[s] = 2 * l.incidences[at].y + begun[at];
      begun[at] = 1;
    }
  }
}

LandmarkFactors LiveSchur::FactorsOf(const FactorRef& ref) const {
  LiveFamily& family = families_[ref.family];
  LandmarkFactors factors;
  factors.factors = &ref.factor;
  factors.count = 1;
  factors.residual_size = family.residual_size();
  factors.num_slots = family.num_slots();
  factors.jacobians = family.slots();
  factors.residuals = family.q_data();
  factors.y_targets = family.y_targets();
  factors.landmark_slot = landmark_slot_[ref.family][ref.factor];
  return factors;
}

void LiveSchur::SumLandmark(Landmark* landmark) {
  std::fill_n(landmark->P, 4 * kQuad, 0.0);
  std::fill_n(landmark->eta, kQuad, 0.0);
  for (const FactorRef& ref : landmark->factors) {
    kernels_.landmark_gram(landmark->size, FactorsOf(ref), landmark->P, landmark->eta);
  }
}

void LiveSchur::EliminateLandmark(Landmark* landmark) {
  for (const FactorRef& ref : landmark->factors) {
    kernels_.eliminate(landmark->size, FactorsOf(ref), landmark->U_inv, Y_.data());
  }
  MultiplyLower(landmark->size, landmark->U_inv, landmark->eta, landmark->z);
  double decrement = 0.0;
  for (int k = 0; k < landmark->size; ++k) {
    decrement += 0.5 * landmark->z[k] * landmark->z[k];
  }
  landmark->decrement = decrement;
}

void LiveSchur::BackSubstitute(std::int32_t landmark, double* padded_step) const {
  const Landmark& l = landmarks_[landmark];
  double* step = padded_step + static_cast<std::ptrdiff_t>(l.quad) * kQuad;
  if (!l.in_S) {
    std::fill_n(step, l.size, 0.0);
    return;
  }
  double y[kQuad];
  std::copy_n(l.z, kQuad, y);
  kernels_.back_substitute(l.size, l.incidences.data(), static_cast<int>(l.incidences.size()), Y_.data(), padded_step, y);
  MultiplyLowerTransposed(l.size, l.U_inv, y, step);
}

int LiveSchur::TakeFirstChanged() {
  const int first = first_changed_;
  first_changed_ = S_.num_rows();
  return first;
}

std::int32_t LiveSchur::AllocateY(std::int32_t quads) {
  if (quads < static_cast<std::int32_t>(free_y_.size()) && !free_y_[quads].empty()) {
    const std::int32_t offset = free_y_[quads].back();
    free_y_[quads].pop_back();
    return offset;
  }
  const auto offset = static_cast<std::int32_t>(Y_.size() / kQuad);
  Y_.resize(Y_.size() + static_cast<std::size_t>(quads) * kQuad);
  return offset;
}

void LiveSchur::ReleaseY(std::int32_t offset, std::int32_t quads) {
  if (quads >= static_cast<std::int32_t>(free_y_.size())) {
    free_y_.resize(quads + 1);
  }
  free_y_[quads].push_back(offset);
}

}  // namespace inceres::internal
