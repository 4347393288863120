#include "schur/batch_system.h"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

namespace inceres::internal {
namespace {

constexpr double kRounding = 1e-15;  // times the condition of a landmark
// a frame without factors is damped by this, so that its step is 0
constexpr double kTinyDiagonal = 1e-12;

}  // namespace

BatchSystem::BatchSystem(const FactorGraph& graph, const IncrementalSystem& system)
    : graph_(graph), system_(system) {
  const IncrementalSchur& schur = system.schur();
  row_of_.assign(graph.num_variables(), -1);
  landmark_of_.assign(graph.num_variables(), -1);
  for (int i = 0; i < static_cast<int>(schur.frames().size()); ++i) {
    if (schur.frames()[i].id >= 0) {
      row_of_[schur.frames()[i].id] = i;
    }
  }
  landmarks_.resize(schur.landmarks().size());
  for (int l = 0; l < static_cast<int>(landmarks_.size()); ++l) {
    const IncrementalSchur::Landmark& landmark = schur.landmarks()[l];
    if (landmark.id >= 0) {
      landmark_of_[landmark.id] = l;
      landmarks_[l].P = Matrix::Zero(landmark.size, landmark.size);
      landmarks_[l].l = Vector::Zero(landmark.size);
    }
  }
  S_ = Matrix::Zero(size(), size());
  b_ = Vector::Zero(size());
  for (const IncrementalFamily& family : system.families()) {
    SumFamily(family);
  }
  C_diagonal_ = S_.diagonal();
  law_.assign(schur.frames().size(), kLaw);
  for (int l = 0; l < static_cast<int>(landmarks_.size()); ++l) {
    if (schur.landmarks()[l].id < 0) {
      continue;
    }
    landmarks_[l].smallest = SmallestEigenvalue(l);
    if (schur.IsInS(l)) {
      Eliminate(l);
    }
  }
}

void BatchSystem::SumFamily(const IncrementalFamily& family) {
  for (int i = 0; i < graph_.NumFactors(family.id()); ++i) {
    if (graph_.HasFactor(family.id(), i)) {
      ASSERT_TRUE(family.weighed().linearized(i));
      SumFactor(family, i);
    }
  }
}

void BatchSystem::SumFactor(const IncrementalFamily& family, int i) {
  ++num_factors_;
  cost_ += family.weighed().Cost(i);
  const Vector q = Eigen::Map<const Eigen::VectorXd>(family.weighed().q(i), family.residual_size())
                       .cast<long double>();
  std::vector<std::pair<int, Matrix>> frames;
  Landmark* landmark = nullptr;
  Matrix J_landmark;
  for (int s = 0; s < family.num_slots(); ++s) {
    const VariableId id = graph_.Variables(family.id(), i)[s];
    const SlotJacobians& slot = family.slots()[s];
    Matrix block(family.residual_size(), slot.columns);
    for (int r = 0; r < family.residual_size(); ++r) {
      for (int c = 0; c < slot.columns; ++c) {
        block(r, c) = family.Jacobian(i, s)[r * slot.row_stride + c];
      }
    }
    if (row_of_[id] >= 0) {
      frames.emplace_back(row_of_[id], std::move(block));
    } else if (landmark_of_[id] >= 0 && !graph_.IsConstant(id)) {
      ASSERT_EQ(landmark, nullptr) << "two free landmarks in a factor";
      landmark = &landmarks_[landmark_of_[id]];
      J_landmark = std::move(block);
    }
  }
  const auto offset = [this](int row) { return system_.schur().FrameOffset(row); };
  for (const auto& [row, J] : frames) {
    b_.segment(offset(row), J.cols()) -= J.transpose() * q;
    for (const auto& [column, K] : frames) {
      S_.block(offset(row), offset(column), J.cols(), K.cols()) += J.transpose() * K;
    }
  }
  if (landmark == nullptr) {
    return;
  }
  landmark->P += J_landmark.transpose() * J_landmark;
  landmark->l -= J_landmark.transpose() * q;
  for (const auto& [row, J] : frames) {
    auto& separators = landmark->separators;
    auto at = std::find_if(separators.begin(), separators.end(),
                           [row = row](const Separator& s) { return s.row == row; });
    if (at == separators.end()) {
      at = separators.insert(at, {row, Matrix::Zero(J.cols(), J_landmark.cols())});
    }
    at->W += J.transpose() * J_landmark;
  }
}

// P with the damping the landmark took up.
BatchSystem::Matrix BatchSystem::Damped(int landmark) const {
  Matrix P = landmarks_[landmark].P;
  P.diagonal() *= 1.0L + static_cast<long double>(system_.schur().blocks().lambda(landmark));
  return P;
}

// 0 where a coordinate has no information.
long double BatchSystem::SmallestEigenvalue(int landmark) const {
  const Matrix P = Damped(landmark);
  const Vector scale = P.diagonal().cwiseSqrt();
  if (scale.size() > 0 && !(scale.minCoeff() > 0.0)) {
    return 0.0;
  }
  const Matrix scaled = scale.cwiseInverse().asDiagonal() * P * scale.cwiseInverse().asDiagonal();
  return Eigen::SelfAdjointEigenSolver<Matrix>(scaled, Eigen::EigenvaluesOnly).eigenvalues()[0];
}

void BatchSystem::Eliminate(int landmark) {
  const Landmark& l = landmarks_[landmark];
  const Eigen::LLT<Matrix> P(Damped(landmark));
  ASSERT_EQ(P.info(), Eigen::Success);
  const double law = kRounding / static_cast<double>(l.smallest);
  widest_law_ = std::max(widest_law_, law);
  for (const Separator& row : l.separators) {
    const Matrix W_P_inv = P.solve(row.W.transpose()).transpose();
    b_.segment(system_.schur().FrameOffset(row.row), row.W.rows()) -= W_P_inv * l.l;
    law_[row.row] = std::max(law_[row.row], law);
    for (const Separator& column : l.separators) {
      S_.block(system_.schur().FrameOffset(row.row), system_.schur().FrameOffset(column.row),
               row.W.rows(), column.W.rows()) -= W_P_inv * column.W.transpose();
    }
  }
}

void BatchSystem::ExpectLaw() const {
  ASSERT_NO_FATAL_FAILURE(ExpectLandmarks());
  ASSERT_NO_FATAL_FAILURE(ExpectS());
  ASSERT_NO_FATAL_FAILURE(ExpectB());
  ASSERT_EQ(system_.num_factors(), num_factors_);
  ASSERT_EQ(graph_.num_factors(), num_factors_);
  ASSERT_LE(std::fabs(system_.cost() - static_cast<double>(cost_)),
            kLaw * static_cast<double>(cost_));
}

void BatchSystem::ExpectLandmarks() const {
  int num_undetermined = 0;
  for (int l = 0; l < static_cast<int>(landmarks_.size()); ++l) {
    const IncrementalSchur::Landmark& landmark = system_.schur().landmarks()[l];
    if (landmark.id < 0) {
      ASSERT_FALSE(system_.schur().IsInS(l));
      continue;
    }
    num_undetermined += system_.schur().blocks().state(l) == LandmarkState::kUndetermined ? 1 : 0;
    ASSERT_EQ(landmark.held, graph_.IsConstant(landmark.id));
    const bool empty = landmarks_[l].smallest == 0.0;
    if (landmark.held || empty) {
      ASSERT_FALSE(system_.schur().IsInS(l)) << "landmark " << landmark.id;
    } else if (landmarks_[l].smallest > 1e-11) {
      ASSERT_TRUE(system_.schur().IsInS(l)) << "landmark " << landmark.id << " has information";
    }
  }
  ASSERT_EQ(system_.schur().blocks().num_undetermined(), num_undetermined);
}

double BatchSystem::IncrementalS(int row, int column, int r, int c) const {
  const SymmetricBlockRows& S = system_.schur().S();
  const std::int64_t offset = S.Find(row, column);
  return offset < 0 ? 0.0 : S.values(offset)[r * PadToQuad(S.size_of(column)) + c];
}

void BatchSystem::ExpectS() const {
  const IncrementalSchur& schur = system_.schur();
  const Eigen::VectorXd scale = C_diagonal_.cast<double>().cwiseSqrt();
  for (int row = 0; row < schur.S().num_rows(); ++row) {
    ASSERT_EQ(schur.S().size_of(row), schur.frames()[row].size);
    for (int column = 0; column <= row; ++column) {
      for (int r = 0; r < schur.S().size_of(row); ++r) {
        for (int c = 0; c < schur.S().size_of(column); ++c) {
          const int i = schur.FrameOffset(row) + r;
          const int j = schur.FrameOffset(column) + c;
          const auto batch = static_cast<double>(S_(i, j));
          ASSERT_LE(std::fabs(IncrementalS(row, column, r, c) - batch),
                    std::min(law_[row], law_[column]) * scale[i] * scale[j])
              << "S(" << i << ", " << j << ") = " << batch << ", rows " << row << ", " << column;
        }
      }
    }
  }
}

void BatchSystem::ExpectB() const {
  const IncrementalSchur& schur = system_.schur();
  for (int row = 0; row < schur.S().num_rows(); ++row) {
    for (int r = 0; r < schur.S().size_of(row); ++r) {
      const int i = schur.FrameOffset(row) + r;
      const auto C = static_cast<double>(C_diagonal_[i]);
      ASSERT_LE(std::fabs(schur.b(row)[r] - static_cast<double>(b_[i])),
                law_[row] * std::sqrt(2.0 * C * static_cast<double>(cost_)))
          << "b(" << i << ") = " << b_[i] << ", row " << row;
      ASSERT_LE(std::fabs(schur.FrameDiagonal(row)[r] - C), kLaw * C) << "C(" << i << ")";
    }
  }
}

BatchSystem::Vector BatchSystem::SolveFrames(double mu) const {
  Matrix damped = S_;
  Vector b = b_;
  for (int row = 0; row < system_.schur().S().num_rows(); ++row) {
    const IncrementalSchur::Frame& frame = system_.schur().frames()[row];
    for (int i = system_.schur().FrameOffset(row); i < system_.schur().FrameOffset(row + 1); ++i) {
      damped(i, i) += mu * std::max(C_diagonal_[i], static_cast<long double>(kTinyDiagonal));
      if (frame.held) {
        damped.row(i).setZero();
        damped.col(i).setZero();
        damped(i, i) = 1.0;
        b[i] = 0.0;
      }
    }
  }
  return damped.llt().solve(b);
}

void BatchSystem::ExpectStep(const std::vector<double>& frame_step, double mu) const {
  const IncrementalSchur& schur = system_.schur();
  const Vector expected = SolveFrames(mu);
  ASSERT_EQ(static_cast<int>(frame_step.size()), size());
  std::vector<double> padded;
  const auto room = [&padded](std::int32_t quad, int count) {
    padded.resize(std::max<std::size_t>(padded.size(),
                                        static_cast<std::size_t>(quad) * kQuad + PadToQuad(count)),
                  0.0);
    return padded.data() + std::ptrdiff_t{quad} * kQuad;
  };
  long double error = 0.0;
  long double norm = 0.0;
  for (int row = 0; row < static_cast<int>(schur.frames().size()); ++row) {
    const IncrementalSchur::Frame& frame = schur.frames()[row];
    ASSERT_EQ(frame.held, frame.id >= 0 && graph_.IsConstant(frame.id));
    for (int k = 0, i = schur.FrameOffset(row); k < frame.size; ++k, ++i) {
      room(frame.quad, frame.size)[k] = frame_step[i];
      error += C_diagonal_[i] * (frame_step[i] - expected[i]) * (frame_step[i] - expected[i]);
      norm += C_diagonal_[i] * expected[i] * expected[i];
    }
  }
  for (int l = 0; l < static_cast<int>(landmarks_.size()); ++l) {
    const IncrementalSchur::Landmark& landmark = schur.landmarks()[l];
    if (landmark.id < 0 || !schur.IsInS(l)) {
      continue;
    }
    Vector rhs = landmarks_[l].l;
    for (const Separator& separator : landmarks_[l].separators) {
      rhs -= separator.W.transpose() *
             expected.segment(schur.FrameOffset(separator.row), separator.W.rows());
    }
    const Vector delta = Damped(l).llt().solve(rhs);
    double* step = room(landmark.quad, landmark.size);
    schur.blocks().BackSubstitute(l, padded.data());
    for (int k = 0; k < landmark.size; ++k) {
      error += landmarks_[l].P(k, k) * (step[k] - delta[k]) * (step[k] - delta[k]);
      norm += landmarks_[l].P(k, k) * delta[k] * delta[k];
    }
  }
  ASSERT_LE(static_cast<double>(std::sqrt(error)),
            widest_law_ *
                static_cast<double>(100.0L * std::sqrt(norm) + 10.0L * std::sqrt(2.0L * cost_)));
}

}  // namespace inceres::internal
