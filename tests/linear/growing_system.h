#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "inceres/linear/reduced_solver.h"
#include "linear/block_rows.h"
#include "linear/envelope_order.h"
#include "linear/row_order.h"
#include "support/random_values.h"

namespace inceres::internal {

/// The rows as they arrived.
inline RowOrder ArrivalOrder(const SymmetricBlockRows& S) {
  RowOrder order;
  order.Follow(S, 0);
  return order;
}

inline double EnvelopeFlops(const SymmetricBlockRows& S, const char* held, const RowOrder& order,
                            int first_place) {
  std::vector<int> workspace;
  return EnvelopeWork(S, held, order, first_place, &workspace).flops;
}

/// A living S of mixed block sizes, symmetric positive definite and well conditioned: each row
/// coupled to a few recent ones and now and then to a far one. With damping, a mask and a
/// right-hand side.
struct GrowingSystem {
  explicit GrowingSystem(unsigned seed) : random(seed) {}

  int num_rows() const { return S.num_rows(); }
  int OffsetOf(int row) const {
    int offset = 0;
    for (int i = 0; i < row; ++i) {
      offset += S.size_of(i);
    }
    return offset;
  }
  int size() const { return OffsetOf(num_rows()); }

  void AddRow(int size_of_row, int band, bool loop) {
    const int row = S.AddRow(size_of_row);
    for (int column = std::max(0, row - band); column < row; ++column) {
      Couple(row, column);
    }
    if (loop && row > band) {
      Couple(row, random.Below(row));
    }
    Perturb(row);
    held.push_back(0);
    for (int k = 0; k < size_of_row; ++k) {
      damping.push_back(0.25);
      b.push_back(random.Unit());
      x.push_back(77.0);
    }
  }

  // Changes the diagonal block of a row, keeping it dominant.
  void Perturb(int row) {
    if (S.size_of(row) == 0) {
      return;
    }
    double* block = S.values(S.FindOrAdd(row, row));
    const int stride = PadToQuad(S.size_of(row));
    for (int r = 0; r < S.size_of(row); ++r) {
      for (int c = 0; c < S.size_of(row); ++c) {
        block[r * stride + c] = r == c ? diagonal_entry + random.Unit() : 0.3;
      }
    }
  }

  void Couple(int row, int column) {
    if (S.size_of(row) == 0 || S.size_of(column) == 0) {
      return;
    }
    double* block = S.values(S.FindOrAdd(row, column));
    for (int r = 0; r < S.size_of(row); ++r) {
      for (int c = 0; c < S.size_of(column); ++c) {
        block[r * PadToQuad(S.size_of(column)) + c] = coupling * random.Unit();
      }
    }
  }

  // Takes the row's first block away, if it is not the diagonal one.
  void Uncouple(int row) {
    if (S.row(row).size() > 1) {
      S.RemoveBlock(row, S.row(row).front().column);
    }
  }

  void RemoveRow(int row) {
    const int begin = OffsetOf(row);
    const int end = begin + S.size_of(row);
    S.RemoveRow(row);
    for (std::vector<double>* vector : {&damping, &b, &x}) {
      vector->erase(vector->begin() + begin, vector->begin() + end);
    }
  }

  // S + diag(damping) with rows of the identity for the rows held.
  Eigen::MatrixXd Dense() const {
    Eigen::MatrixXd dense = Eigen::MatrixXd::Zero(size(), size());
    for (int i = 0; i < num_rows(); ++i) {
      for (const auto& entry : S.row(i)) {
        CopyBlock(i, entry, &dense);
      }
    }
    for (int i = 0; i < num_rows(); ++i) {
      for (int k = OffsetOf(i); k < OffsetOf(i) + S.size_of(i); ++k) {
        dense(k, k) = held[static_cast<std::size_t>(i)] != 0
                          ? 1.0
                          : dense(k, k) + damping[static_cast<std::size_t>(k)];
      }
    }
    return dense;
  }

  // b with zeros in held rows.
  Eigen::VectorXd FreeB() const {
    Eigen::VectorXd free = Eigen::Map<const Eigen::VectorXd>(b.data(), size());
    for (int i = 0; i < num_rows(); ++i) {
      if (held[static_cast<std::size_t>(i)] != 0) {
        free.segment(OffsetOf(i), S.size_of(i)).setZero();
      }
    }
    return free;
  }

  // As solvers are given it: a held row has the diagonal of the identity, and zeros in b.
  ReducedMatrix Matrix() {
    diagonal_ = damping;
    free_b_ = b;
    for (int i = 0; i < num_rows(); ++i) {
      for (int k = OffsetOf(i);
           held[static_cast<std::size_t>(i)] != 0 && k < OffsetOf(i) + S.size_of(i); ++k) {
        diagonal_[static_cast<std::size_t>(k)] = 1.0;
        free_b_[static_cast<std::size_t>(k)] = 0.0;
      }
    }
    return {S, diagonal_.data(), held.data()};
  }
  Status Factorize(const ReducedSolver::Rows& changed, ReducedSolver* solver) {
    const ReducedMatrix A = Matrix();
    const bool is_new = std::exchange(analyzed_version_, S.version()) != S.version();
    const Status analyzed = is_new ? solver->Analyze(A) : Status::Ok();
    return analyzed.ok() ? solver->Factorize(A, changed) : analyzed;
  }
  Status Solve(const ReducedSolver::Rows& changed_b, const ReducedSolver::Truncation& truncation,
               ReducedSolver* solver) {
    Matrix();
    return solver->Solve(free_b_.data(), changed_b, truncation, x.data());
  }

  Eigen::VectorXd X() const { return Eigen::Map<const Eigen::VectorXd>(x.data(), size()); }

  test::Random random;
  SymmetricBlockRows S;
  std::vector<char> held;
  std::vector<double> damping;
  std::vector<double> b;
  std::vector<double> x;
  double diagonal_entry = 50.0;
  double coupling = 0.2;

 private:
  std::vector<double> diagonal_;
  std::vector<double> free_b_;
  std::int64_t analyzed_version_ = -1;

  void CopyBlock(int i, const SymmetricBlockRows::Entry& entry, Eigen::MatrixXd* dense) const {
    const bool left_out =
        held[static_cast<std::size_t>(i)] != 0 || held[static_cast<std::size_t>(entry.column)] != 0;
    const int stride = PadToQuad(S.size_of(entry.column));
    for (int r = 0; r < S.size_of(i) && !left_out; ++r) {
      for (int c = 0; c < S.size_of(entry.column); ++c) {
        const double value = S.values(entry.offset)[r * stride + c];
        (*dense)(OffsetOf(i) + r, OffsetOf(entry.column) + c) = value;
        (*dense)(OffsetOf(entry.column) + c, OffsetOf(i) + r) = value;
      }
    }
  }
};

/// A random change to a system: rows appended, changed, removed, held or freed, damping and b
/// changed. What a solver must be told.
struct RandomChange {
  RandomChange(GrowingSystem* system, bool may_hold) {
    change.first_row = system->num_rows();
    first_b = system->num_rows();
    test::Random& random = system->random;
    for (int edit = random.Below(4); edit >= 0; --edit) {
      const int row = random.Below(std::max(1, system->num_rows()));
      const int kind = system->num_rows() < 3 ? 0 : random.Below(9);
      if (kind <= 1) {
        Touch(system->num_rows());
        system->AddRow(1 + random.Below(9), 1 + random.Below(6), random.Below(4) == 0);
      } else if (kind <= 3) {
        system->Perturb(row);
        Touch(row);
      } else if (kind == 4 && random.Below(3) == 0) {
        system->RemoveRow(row);
        Touch(row);
        first_b = std::min(first_b, row);
      } else if (kind == 5 && may_hold) {
        system->held[static_cast<std::size_t>(row)] ^= 1;
        Touch(row);
      } else if (kind == 6) {
        for (std::size_t k = static_cast<std::size_t>(system->OffsetOf(row)); k < system->b.size();
             ++k) {
          system->b[k] = random.Unit();
        }
        first_b = std::min(first_b, row);
      } else if (kind == 7) {
        const int column = random.Below(row + 1);
        if (column < row) {
          system->Couple(row, column);
          Touch(row);
        }
      } else if (kind == 8) {
        system->Uncouple(row);
        Touch(row);
      }
    }
    std::sort(rows.begin(), rows.end());
    rows.erase(std::unique(rows.begin(), rows.end()), rows.end());
    change.rows = &rows;
  }
  RandomChange(const RandomChange&) = delete;
  RandomChange& operator=(const RandomChange&) = delete;

  void Touch(int row) {
    change.first_row = std::min(change.first_row, row);
    rows.push_back(row);
  }

  std::vector<int> rows;
  ReducedSolver::Rows change;
  int first_b = 0;
};

}  // namespace inceres::internal
