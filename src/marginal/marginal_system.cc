#include "marginal/marginal_system.h"

#include <algorithm>
#include <string>

#include "linearize/jacobian_map.h"
#include "marginal/row_elimination.h"
#include "marginal/singular_values.h"

namespace inceres::internal {

// The linear system of one marginalization, without H (docs/algorithms.md, "Marginalization"). Rows
// [J_m J_r f] of the factors are gathered; a landmark's rows are reduced by an orthogonal
// transformation of their own as they come in, because they have entries for that landmark and its
// frames only, and what is left goes to a common stack. Then the marginalized frames are eliminated
// from the stack. An orthogonal transformation changes neither JᵀJ nor Jᵀf, so the rows that are
// left have the Schur complement as their JᵀJ, with the digits that H would have squared away.
//
// The stack is row-major and grows by rows of one width: marginalized frames, kept variables, f.
// Landmarks have no columns in it. A variable without columns, such as a constant, counts as known.

void MarginalSystem::AddMarginalized(VariableId id) {
  if (graph_.role(id) == Role::kLandmark) {
    // The number is the order of the request, in which they are eliminated later.
    landmarks_.emplace(id, static_cast<int>(landmarks_.size()));
    return;
  }
  frames_.push_back(id);
  columns_.emplace(id, num_frame_columns_);
  num_frame_columns_ += graph_.TangentSize(id);
}

void MarginalSystem::AddKept(VariableId id) {
  // Behind all marginalized ones, which is why those have to come first.
  columns_.emplace(id, NumColumns());
  num_kept_columns_ += graph_.TangentSize(id);
}

void MarginalSystem::Append(const Eigen::MatrixXd& rows, Eigen::Index first_row,
                            Eigen::Index first_column, const std::vector<int>& columns) {
  // Rows from first_row on, spread to the columns of the stack; what they do not have is zero.
  const auto width = static_cast<std::size_t>(NumColumns()) + 1;
  for (Eigen::Index r = first_row; r < rows.rows(); ++r) {
    const std::size_t at = stack_.size();
    stack_.resize(at + width, 0.0);
    for (std::size_t c = 0; c < columns.size(); ++c) {
      stack_[at + static_cast<std::size_t>(columns[c])] =
          rows(r, first_column + static_cast<Eigen::Index>(c));
    }
    stack_[at + width - 1] = rows(r, rows.cols() - 1);
  }
}

Status MarginalSystem::RankLoss(const char* kind, const std::vector<VariableId>& offenders) const {
  std::string ids;
  for (const VariableId id : offenders) {
    ids += (ids.empty() ? "" : ", ") + std::to_string(id);
  }
  return Status::Error(
      StatusCode::kSingular,
      std::string("the factors do not determine the marginalized ") + kind + " " + ids +
          ": drop them, or allow rank loss, or keep what they are measured against");
}

Status MarginalSystem::Eliminate(const std::vector<FactorId>& factors, const RowsOf& rows_of,
                                 std::vector<VariableId>* offenders) {
  // Factors by marginalized landmark, of which each has one at most. The others are stacked at
  // once.
  std::vector<std::vector<FactorId>> of_landmark(landmarks_.size());
  std::vector<VariableId> landmark_ids(landmarks_.size());
  for (const auto& [id, number] : landmarks_) {
    landmark_ids[static_cast<std::size_t>(number)] = id;
  }
  for (const FactorId& id : factors) {
    const int num_slots = graph_.family(id.family).num_slots();
    const VariableId* ids = graph_.Variables(id.family, id.index);
    const auto landmark = std::find_if(ids, ids + num_slots,
                                       [this](VariableId v) { return landmarks_.count(v) > 0; });
    if (landmark != ids + num_slots) {
      of_landmark[static_cast<std::size_t>(landmarks_.at(*landmark))].push_back(id);
      continue;
    }
    const Status status = StackRows(-1, {id}, rows_of, offenders);
    if (!status.ok()) {
      return status;
    }
  }
  for (std::size_t l = 0; l < landmark_ids.size(); ++l) {
    const Status status = StackRows(landmark_ids[l], of_landmark[l], rows_of, offenders);
    if (!status.ok()) {
      return status;
    }
  }
  // By now all landmarks have been looked at: the status names every one at fault.
  return offenders->empty() ? EliminateFrames(offenders) : RankLoss("landmarks", *offenders);
}

MarginalSystem::OwnColumns MarginalSystem::OwnColumnsOf(
    VariableId landmark, const std::vector<FactorId>& factors) const {
  OwnColumns own;
  if (landmark >= 0) {
    own.first.emplace(landmark, 0);
    own.of_landmark = graph_.TangentSize(landmark);
  }
  for (const FactorId& factor : factors) {
    own.num_rows += graph_.family(factor.family).residual_size();
    for (int s = 0; s < graph_.family(factor.family).num_slots(); ++s) {
      const VariableId other = graph_.Variables(factor.family, factor.index)[s];
      const auto global = columns_.find(other);
      if (global != columns_.end() &&
          // A frame gets its columns with the first factor that touches it: an order that the
          // factors give.
          own.first.emplace(other, own.of_landmark + static_cast<int>(own.of_frames.size()))
              .second) {
        for (int c = 0; c < graph_.TangentSize(other); ++c) {
          own.of_frames.push_back(global->second + c);
        }
      }
    }
  }
  return own;
}

// A landmark's rows have columns of its own and those of its separator only. Rank loss is reported
// when all landmarks have been looked at.
Status MarginalSystem::StackRows(VariableId landmark, const std::vector<FactorId>& factors,
                                 const RowsOf& rows_of, std::vector<VariableId>* offenders) {
  // A is as wide as the landmark and the frames it is seen from, not as the whole system.
  const OwnColumns own = OwnColumnsOf(landmark, factors);
  const int size = own.of_landmark;
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(
      own.num_rows, size + static_cast<Eigen::Index>(own.of_frames.size()) + 1);
  Eigen::Index row = 0;
  for (const FactorId& factor_id : factors) {
    LinearizedFactor factor;
    const Status status = rows_of(factor_id, &factor);
    if (!status.ok()) {
      return status;
    }
    const VariableId* ids = graph_.Variables(factor_id.family, factor_id.index);
    for (int s = 0; s < graph_.family(factor_id.family).num_slots(); ++s) {
      const SlotJacobians& slot = factor.slots[s];
      const auto column = own.first.find(ids[s]);
      // No column: a constant, or what is not part of the system.
      if (column != own.first.end()) {
        A.block(row, column->second, factor.rows, slot.columns) = JacobianOf(slot, 0, factor.rows);
      }
    }
    // The right-hand side is the last column, and takes part in every transformation.
    A.col(A.cols() - 1).segment(row, factor.rows) =
        Eigen::Map<const Eigen::VectorXd>(factor.f, factor.rows);
    row += factor.rows;
  }
  // Where the rank falls short, fewer rows are used up, and what the others say of the frames
  // stays.
  const EliminationOutcome outcome = EliminateColumns(size, options_.rank_tolerance, &A);
  if (outcome.rank < size && !options_.allow_rank_loss) {
    offenders->push_back(landmark);
  }
  Append(A, outcome.rank, size, own.of_frames);
  return Status::Ok();
}

Status MarginalSystem::EliminateFrames(std::vector<VariableId>* offenders) {
  const Eigen::Index width = NumColumns() + 1;
  const auto rows = static_cast<Eigen::Index>(stack_.size()) / width;
  Eigen::MatrixXd A = Eigen::Map<const RowMajor>(stack_.data(), rows, width);
  const EliminationOutcome outcome =
      EliminateColumns(num_frame_columns_, options_.rank_tolerance, &A);
  for (const VariableId id : frames_) {
    const int first = columns_.at(id);
    // A dependent column is an offense of the frame that it belongs to.
    const auto mine = [&](int column) {
      return column >= first && column < first + graph_.TangentSize(id);
    };
    if (std::any_of(outcome.dependent.begin(), outcome.dependent.end(), mine)) {
      offenders->push_back(id);
    }
  }
  if (!offenders->empty() && !options_.allow_rank_loss) {
    return RankLoss("variables", *offenders);
  }
  offenders->clear();
  // What the eliminated frames cannot explain away.
  result_ = A.bottomRightCorner(rows - outcome.rank, num_kept_columns_ + 1);
  // Square from here on, with rows of zeros where there is less to say.
  fixed_cost_ = 0.5 * ReduceToTriangle(&result_);
  return Status::Ok();
}

// J = U Σ Vᵀ: the eigenvalues of JᵀJ are σ². Of what stays, Σ Vᵀ is the root of the information and
// Uᵀe₀ its residual, so that Jᵀe₀ is right in the directions that are kept.
int TruncatePrior(const MarginalizationOptions& options, Eigen::MatrixXd* prior) {
  const Eigen::Index n = prior->rows();
  if (options.threshold == PriorThreshold::kNone || n == 0) {
    return 0;
  }
  const bool relative = options.threshold == PriorThreshold::kRelative;
  Eigen::VectorXd scale = Eigen::VectorXd::Ones(n);
  if (relative) {
    const Eigen::VectorXd norms = prior->leftCols(n).colwise().norm();
    // OKVIS scales the information to a unit diagonal first: units of rotations and positions drop
    // out of the comparison. A column of zeros stays as it is.
    scale = (norms.array() > 0.0).select(norms, 1.0);
  }
  const Eigen::BDCSVD<Eigen::MatrixXd> svd(prior->leftCols(n) * scale.cwiseInverse().asDiagonal(),
                                           Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::VectorXd& sigma = svd.singularValues();  // descending
  const double limit =
      relative ? options.epsilon * static_cast<double>(n) * sigma[0] * sigma[0] : options.epsilon;
  const auto rank = (sigma.array().square() > limit).count();
  if (rank == n) {
    return 0;  // nothing is cut off: the triangle is the more exact form
  }
  const Eigen::VectorXd e0 = svd.matrixU().leftCols(rank).transpose() * prior->col(n);
  prior->setZero();
  prior->topLeftCorner(rank, n) =
      sigma.head(rank).asDiagonal() * svd.matrixV().leftCols(rank).transpose() * scale.asDiagonal();
  prior->col(n).head(rank) = e0;
  return static_cast<int>(n - rank);
}

}  // namespace inceres::internal
