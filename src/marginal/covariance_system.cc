#include "marginal/covariance_system.h"

#include <algorithm>
#include <utility>

#include "linearize/jacobian_map.h"

namespace inceres::internal {

// Covariances in three steps (docs/algorithms.md, "Covariance"): the undamped system is factored,
// and refused if it leaves anything open (FactoredNormals); what pairs need of S⁻¹ is found, entry
// by entry or by solves, whichever is cheaper; and a block is put together from it,
//     cov(a, b) = V_aᵀ S⁻¹ V_b + [a = b is a landmark] P_b⁻¹.

// V of landmarks comes from their Jacobians.
CovarianceSystem::CovarianceSystem(const FactorGraph& graph, const std::vector<double>& state,
                                   const CovarianceOptions& options, bool has_landmarks)
    : normals_(graph, state, options, /*keeps_jacobians=*/has_landmarks),
      layout_(normals_.layout()) {
}

// V of a frame is a unit matrix, that of a landmark zero for now.
void CovarianceSystem::MakeColumn(VariableId id) {
  Column& column = columns_[id];
  const int size = normals_.graph().TangentSize(id);
  const int landmark = layout_.LandmarkOf(id);
  if (landmark >= 0 && normals_.by_rows() != nullptr) {
    return MakeColumnByRows(landmark, &column);
  }
  if (landmark < 0) {
    column.frames = {layout_.FrameOf(id)};
  } else {
    // In the order of the incidences; rows of V follow it.
    column.frames.assign(
        normals_.incidences().frames.begin() + normals_.incidences().begin[landmark],
        normals_.incidences().frames.begin() + normals_.incidences().begin[landmark + 1]);
  }
  int rows = 0;
  for (const int frame : column.frames) {
    column.rows.push_back(rows);
    rows += layout_.TangentSize(frame);
  }
  column.V.setZero(rows, size);
  if (landmark < 0) {
    column.V.setIdentity();
    return;
  }
  const Eigen::Map<const RowMajor, 0, Eigen::OuterStride<>> lower(
      normals_.elimination().UInv(landmark), size, size, Eigen::OuterStride<>(kQuad));
  const Eigen::MatrixXd U_inv = lower.triangularView<Eigen::Lower>();
  column.P_inv = U_inv.transpose() * U_inv;
}

// V −= W P⁻¹ of the landmarks there are columns of, W = Σ J_cᵀ J_l, in one pass over the factors.
// One pass for all landmarks that are asked for, rather than one for each: factors are not listed
// by landmark here.
void CovarianceSystem::SubtractW() {
  for (const Linearization& cache : normals_.evaluator().families()) {
    const int num_slots = cache.num_slots;
    for (int i = 0; i < cache.num_factors; ++i) {
      const VariableId* ids = normals_.graph().Variables(cache.id, i);
      const int landmark = layout_.LandmarkAmong(ids, num_slots);
      const VariableId id = landmark < 0 ? -1 : layout_.variables[layout_.num_frames + landmark];
      // Most factors are of landmarks that nobody asks for.
      const auto wanted = columns_.find(id);
      if (wanted == columns_.end()) {
        continue;
      }
      const auto jacobian = [&](std::ptrdiff_t s) {
        return JacobianOf(cache.slots[s], i, cache.residual_size);
      };
      Column& column = wanted->second;
      // P⁻¹ on the landmark's side first: a product of its few columns, for all frames of the
      // factor.
      const Eigen::MatrixXd J_l =
          jacobian(std::find(ids, ids + num_slots, id) - ids) * column.P_inv;
      // A factor of a landmark and several frames adds to the rows of each.
      for (int s = 0; s < num_slots; ++s) {
        const int frame = layout_.FrameOf(ids[s]);
        if (frame >= 0) {
          const auto at = std::find(column.frames.begin(), column.frames.end(), frame);
          column.V.middleRows(column.rows[at - column.frames.begin()],
                              layout_.TangentSize(frame)) -= jacobian(s).transpose() * J_l;
        }
      }
    }
  }
}

// V = −W P⁻¹ = −Tᵀ R⁻ᵀ, and P⁻¹ = R⁻¹ R⁻ᵀ.
void CovarianceSystem::MakeColumnByRows(int landmark, Column* column) {
  OrthogonalElimination::Landmark eliminated = normals_.by_rows()->Eliminate(landmark);
  // P = RᵀR and W = TᵀR, since Q drops out of J_cᵀJ_l.
  const Eigen::MatrixXd R_inv = eliminated.InverseOfR();
  column->frames = std::move(eliminated.rest.blocks);
  // The frames are those of its factors, ascending, as T has its columns.
  int rows = 0;
  for (const int frame : column->frames) {
    column->rows.push_back(rows);
    rows += layout_.TangentSize(frame);
  }
  column->V = -eliminated.T.transpose() * R_inv.transpose();
  column->P_inv = R_inv * R_inv.transpose();
}

Status CovarianceSystem::SolveFor(VariableId id) {
  Column& column = columns_.at(id);
  // V as dense columns, of all frames.
  Eigen::MatrixXd right = Eigen::MatrixXd::Zero(layout_.frame_size(), column.V.cols());
  for (std::size_t i = 0; i < column.frames.size(); ++i) {
    const int frame = column.frames[i];
    right.middleRows(layout_.packed_offset[frame], layout_.TangentSize(frame)) =
        column.V.middleRows(column.rows[i], layout_.TangentSize(frame));
  }
  Status status = normals_.Solve(right, &column.X);
  const int frame = layout_.FrameOf(id);
  // V of a frame is the unit matrix, so that the diagonal of X has its variances. A landmark was
  // tested for known frames, and its frames by the gauge.
  for (int k = 0; frame >= 0 && status.ok() && k < normals_.graph().TangentSize(id); ++k) {
    status = normals_.CheckVariance(frame, k, column.X(layout_.packed_offset[frame] + k, k));
  }
  return status;
}

// Takes the entries of S⁻¹ where L has any; then all variances are at hand, and each is tested.
Status CovarianceSystem::InvertFactor() {
  inverse_ =
      std::make_unique<SelectedInverse>(normals_.factor(), normals_.pattern(), normals_.executor());
  Status status;
  for (int frame = 0; frame < layout_.num_frames; ++frame) {
    for (int k = 0; status.ok() && k < layout_.TangentSize(frame); ++k) {
      status = normals_.CheckVariance(frame, k, inverse_->Diagonal(frame, k));
    }
  }
  return status;
}

// Every frame of one with every frame of the other: frames that share nothing are mostly not among
// the entries.
bool CovarianceSystem::IsSelected(const Column& a, const Column& b) const {
  return inverse_ != nullptr && std::all_of(a.frames.begin(), a.frames.end(), [&](int i) {
           return std::all_of(b.frames.begin(), b.frames.end(),
                              [&](int j) { return inverse_->Has(i, j); });
         });
}

// One solution a pair is enough: that of the variable with more of the pairs that need one.
Status CovarianceSystem::SolveForPairs(const GraphCovariance::Pairs& pairs) {
  GraphCovariance::Pairs open;
  std::map<VariableId, int> count;
  for (const auto& [a, b] : pairs) {
    if (!IsSelected(columns_.at(a), columns_.at(b))) {
      open.emplace_back(a, b);
      ++count[a];
      ++count[b];
    }
  }
  Status status;
  for (const auto& [a, b] : open) {
    // A solution that an earlier pair needed serves this one as well.
    if (status.ok() && columns_.at(a).X.size() == 0 && columns_.at(b).X.size() == 0) {
      status = SolveFor(count[a] > count[b] ? a : b);
    }
  }
  return status;
}

Status CovarianceSystem::Factorize(const GraphCovariance::Pairs& pairs) {
  const Status factored = normals_.Factorize();
  return factored.ok() ? Prepare(pairs) : factored;
}

// Columns V of all variables first, whose sizes tell what solves would cost.
Status CovarianceSystem::Prepare(const GraphCovariance::Pairs& pairs) {
  double wanted_columns = 0.0;
  bool wants_landmarks = false;
  for (const auto& pair : pairs) {
    for (const VariableId id : {pair.first, pair.second}) {
      if (columns_.count(id) == 0) {
        MakeColumn(id);
        wanted_columns += normals_.graph().TangentSize(id);
        wants_landmarks = wants_landmarks || layout_.LandmarkOf(id) >= 0;
      }
    }
  }
  // By rows MakeColumn has all of V already.
  if (wants_landmarks && normals_.by_rows() == nullptr) {
    SubtractW();
  }
  // Landmarks alone: their covariances are P⁻¹.
  if (layout_.num_frames == 0) {
    return Status::Ok();
  }
  Status status;
  // A solve goes through the entries of L twice, forwards and backwards.
  if (SelectedInverse::PredictedFlops(normals_.factor().tree()) <
      2.0 * normals_.factor().PredictedEntries() * wanted_columns) {
    status = InvertFactor();
  }
  return status.ok() ? SolveForPairs(pairs) : status;
}

// V_aᵀ X_b: only the rows of frames that V_a touches.
Eigen::MatrixXd CovarianceSystem::FromSolution(const Column& a, const Column& b) const {
  Eigen::MatrixXd product = Eigen::MatrixXd::Zero(a.V.cols(), b.V.cols());
  for (std::size_t i = 0; i < a.frames.size(); ++i) {
    const int rows = layout_.TangentSize(a.frames[i]);
    product += a.V.middleRows(a.rows[i], rows).transpose() *
               b.X.middleRows(layout_.packed_offset[a.frames[i]], rows);
  }
  return product;
}

// Σ_ij V_aiᵀ (S⁻¹)_ij V_bj: as many products as pairs of frames.
Eigen::MatrixXd CovarianceSystem::FromInverse(const Column& a, const Column& b) const {
  Eigen::MatrixXd product = Eigen::MatrixXd::Zero(a.V.cols(), b.V.cols());
  // Blocks of S⁻¹ come row by row, of any two frames in either order.
  RowMajor block;
  for (std::size_t i = 0; i < a.frames.size(); ++i) {
    for (std::size_t j = 0; j < b.frames.size(); ++j) {
      block.resize(layout_.TangentSize(a.frames[i]), layout_.TangentSize(b.frames[j]));
      inverse_->Block(a.frames[i], b.frames[j], block.data());
      product += a.V.middleRows(a.rows[i], block.rows()).transpose() * block *
                 b.V.middleRows(b.rows[j], block.cols());
    }
  }
  return product;
}

Eigen::MatrixXd CovarianceSystem::Product(VariableId a, VariableId b) const {
  const Column& left = columns_.at(a);
  const Column& right = columns_.at(b);
  Eigen::MatrixXd covariance;
  // A solution goes before the entries of the inverse: it is there for pairs that have no others.
  if (right.X.size() > 0) {
    covariance = FromSolution(left, right);
  } else if (left.X.size() > 0) {
    covariance = FromSolution(right, left).transpose();
  } else {
    covariance = FromInverse(left, right);
  }
  if (a == b && left.P_inv.size() > 0) {
    covariance += left.P_inv;
  }
  return covariance;
}

}  // namespace inceres::internal
