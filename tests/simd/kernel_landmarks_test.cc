// The kernels of the elimination and of the way back against plain loops: landmark sizes 1 to 4,
// residuals from 1 to beyond a slice, several slots of different sizes, a frame that is touched
// twice, a slot without a frame.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <type_traits>

#include "simd/kernel_fixture.h"

namespace inceres::internal {
namespace {

constexpr double kTolerance = 1e-13;
constexpr int kResidualSizes[] = {1, 2, 3, 4, 5, 6, 15, 16, 17, 33};

// Five factors of a family with slots: frame of size 6, the landmark, frame of size 9, frame of
// size 3, unless told. Three of them, in an order of their own, see the landmark; the third slot of
// the last has no frame; the fourth slot is the same frame in all.
struct LandmarkCase {
  LandmarkCase(int landmark_size, int residual_size, test::Random* random,
               std::array<int, 3> frame_sizes = {6, 9, 3})
      : size(landmark_size), rows(residual_size) {
    sizes = {frame_sizes[0], landmark_size, frame_sizes[1], frame_sizes[2]};
    for (const int slot_size : sizes) {
      AlignedVector<double>& values = storage.emplace_back(
          static_cast<std::size_t>(kNumFactors * rows * PadToQuad(slot_size)), 0.0);
      for (int r = 0; r < kNumFactors * rows; ++r) {
        for (int c = 0; c < slot_size; ++c) {
          // Of single precision, so that both hold the same.
          values[static_cast<std::size_t>(r * PadToQuad(slot_size) + c)] =
              static_cast<double>(static_cast<float>(random->Unit()));
        }
      }
      jacobians.push_back({values.data(), std::ptrdiff_t{rows} * PadToQuad(slot_size),
                           PadToQuad(slot_size), slot_size});
    }
    residuals = random->Vector(static_cast<std::size_t>(kNumFactors * rows));
    Place();
    factors.factors = seen.data();
    factors.count = static_cast<int>(seen.size());
    factors.residual_size = rows;
    factors.landmark_slot = kLandmarkSlot;
    factors.num_slots = static_cast<int>(sizes.size());
    factors.jacobians = jacobians.data();
    factors.residuals = residuals.data();
    factors.y_targets = targets.data();
    factors.tangent_offsets = tangent_offsets.data();
  }

  // Where Y and the steps of the variables are.
  void Place() {
    int next = 0;
    int shared = -1;
    targets.assign(static_cast<std::size_t>(kNumFactors) * sizes.size(), -1);
    tangent_offsets = targets;
    for (const std::int32_t factor : seen) {
      for (int s = 0; s < static_cast<int>(sizes.size()); ++s) {
        if (factor == seen.back() && s == 2) {
          continue;
        }
        // A place for each frame; the landmark where nothing of a frame's step is.
        tangent_offsets[static_cast<std::size_t>(factor) * sizes.size() +
                        static_cast<std::size_t>(s)] =
            s == kLandmarkSlot ? kLandmarkQuad : 4 * s + (s == 3 ? 0 : 16 * factor);
        if (s == kLandmarkSlot) {
          continue;
        }
        std::int32_t& target =
            targets[static_cast<std::size_t>(factor) * sizes.size() + static_cast<std::size_t>(s)];
        if (s == 3 && shared >= 0) {
          target = 2 * shared + 1;
          continue;
        }
        target = 2 * next;
        shared = s == 3 ? next : shared;
        next += size * PadToQuad(sizes[static_cast<std::size_t>(s)]) / kQuad;
      }
    }
    y_size = static_cast<std::size_t>(next * kQuad);
  }

  double J(int slot, int factor, int row, int column) const {
    const SlotJacobians& view = jacobians[static_cast<std::size_t>(slot)];
    return view.data[factor * view.factor_stride + row * view.row_stride + column];
  }
  double f(int factor, int row) const {
    return residuals[static_cast<std::size_t>(factor * rows + row)];
  }

  static constexpr int kNumFactors = 5;
  static constexpr int kLandmarkSlot = 1;
  static constexpr int kLandmarkQuad = 90;
  static constexpr int kNumQuads = 91;
  int size;
  int rows;
  std::vector<int> sizes;
  std::vector<std::int32_t> seen = {3, 0, 4};
  std::vector<AlignedVector<double>> storage;
  std::vector<SlotJacobians> jacobians;
  std::vector<double> residuals;
  std::vector<std::int32_t> targets;
  std::vector<std::int32_t> tangent_offsets;
  std::size_t y_size = 0;
  LandmarkFactors factors;
};

// The same Jacobians, those of a factor together, rows without padding, in T. What nobody may use
// is NaN: factors that nobody sees, and what lies between factors and behind the last.
template <typename T>
struct ByFactor {
  explicit ByFactor(const LandmarkCase& padded)
      : jacobians(padded.jacobians), factors(padded.factors) {
    const int row = std::accumulate(padded.sizes.begin(), padded.sizes.end(), 0);
    const std::ptrdiff_t stride = PadToQuad(padded.rows * row);
    entries.assign(static_cast<std::size_t>(LandmarkCase::kNumFactors * stride + kQuad),
                   std::numeric_limits<T>::quiet_NaN());
    std::ptrdiff_t begin = 0;
    for (int s = 0; s < static_cast<int>(jacobians.size()); ++s) {
      SlotJacobians& slot = jacobians[static_cast<std::size_t>(s)];
      for (const int factor : padded.seen) {
        for (int r = 0; r < padded.rows; ++r) {
          for (int c = 0; c < slot.columns; ++c) {
            entries[static_cast<std::size_t>(factor * stride + begin + r * slot.columns + c)] =
                static_cast<T>(padded.J(s, factor, r, c));
          }
        }
      }
      slot = UnpaddedSlot(entries.data() + begin, stride, slot.columns);
      begin += padded.rows * slot.columns;
    }
    factors.jacobians = jacobians.data();
  }

  AlignedVector<T> entries;
  std::vector<SlotJacobians> jacobians;
  LandmarkFactors factors;
};

class LandmarkKernels : public KernelTest {
 protected:
  // All that the kernels make of a landmark's factors, one after the other.
  std::vector<double> Results(const LandmarkCase& problem, const LandmarkFactors& factors,
                              const std::vector<double>& values) const {
    std::vector<double> results;
    const auto add = [&](const AlignedVector<double>& part) {
      results.insert(results.end(), part.begin(), part.end());
    };
    AlignedVector<double> P(16, 0.0), eta(kQuad, 0.0), w(kQuad, 0.0), U_inv(16, 0.0), u(kQuad, 0.0);
    for (int r = 0; r < problem.size; ++r) {
      u[static_cast<std::size_t>(r)] = values[static_cast<std::size_t>(r)];
      for (int c = 0; c <= r; ++c) {
        U_inv[static_cast<std::size_t>(r * kQuad + c)] = values[static_cast<std::size_t>(r + c)];
      }
    }
    kernels().landmark_gram(problem.size, factors, P.data(), eta.data());
    AlignedVector<double> Y(problem.y_size, 0.0);
    kernels().eliminate(problem.size, factors, U_inv.data(), Y.data());
    // Behind a variable's entries vectors are zero.
    AlignedVector<double> delta(LandmarkCase::kNumQuads * kQuad, 0.0), y = delta;
    for (const int factor : problem.seen) {
      for (int s = 0; s < 4; ++s) {
        const int offset = problem.tangent_offsets[static_cast<std::size_t>(factor * 4 + s)];
        for (int c = 0; c < problem.sizes[static_cast<std::size_t>(s)] && offset >= 0; ++c) {
          const auto at = static_cast<std::size_t>(offset * kQuad + c);
          delta[at] = values[at];
        }
      }
    }
    kernels().multiply_coupling(factors, delta.data(), w.data());
    kernels().add_coupling(factors, u.data(), nullptr, y.data());
    for (const AlignedVector<double>* part : {&P, &eta, &Y, &w, &y}) {
      add(*part);
    }
    return results;
  }

  template <typename Check>
  void ForAllSizes(Check&& check) {
    for (int size = 1; size <= 4; ++size) {
      for (const int rows : kResidualSizes) {
        const LandmarkCase problem(size, rows, &random_);
        check(problem,
              "landmark size " + std::to_string(size) + ", residual size " + std::to_string(rows));
        if (HasFatalFailure()) {
          return;
        }
      }
    }
  }
};

TEST_P(LandmarkKernels, GramAddsHAndEtaToWhatIsThere) {
  ForAllSizes([&](const LandmarkCase& problem, const std::string& what) {
    const AlignedVector<double> P_start = PaddedRows(4, problem.size);
    const AlignedVector<double> eta_start = PaddedRows(1, problem.size);
    AlignedVector<double> P = P_start;
    AlignedVector<double> eta = eta_start;
    AlignedVector<double> P_expected = P_start;
    AlignedVector<double> eta_expected = eta_start;
    for (const int factor : problem.seen) {
      for (int i = 0; i < problem.rows; ++i) {
        for (int r = 0; r < problem.size; ++r) {
          for (int c = 0; c < problem.size; ++c) {
            P_expected[static_cast<std::size_t>(r * kQuad + c)] +=
                problem.J(1, factor, i, r) * problem.J(1, factor, i, c);
          }
          eta_expected[static_cast<std::size_t>(r)] -=
              problem.J(1, factor, i, r) * problem.f(factor, i);
        }
      }
    }
    kernels().landmark_gram(problem.size, problem.factors, P.data(), eta.data());
    ExpectClose(P, P_expected, 3.0 * problem.rows, kTolerance, what + ": P");
    ExpectClose(eta, eta_expected, 3.0 * problem.rows, kTolerance, what + ": eta");
  });
}

// Also: a block that is begun is overwritten, whatever stood there before.
TEST_P(LandmarkKernels, EliminateWritesYForEveryFrame) {
  ForAllSizes([&](const LandmarkCase& problem, const std::string& what) {
    double U_inv[16] = {};
    for (int r = 0; r < problem.size; ++r) {
      for (int c = 0; c <= r; ++c) {
        U_inv[r * kQuad + c] = random_.Unit();
      }
    }
    AlignedVector<double> expected(problem.y_size, 0.0);
    for (const int factor : problem.seen) {
      for (int s = 0; s < 4; ++s) {
        const int target = problem.targets[static_cast<std::size_t>(factor * 4 + s)];
        if (target < 0) {
          continue;
        }
        const int stride = PadToQuad(problem.sizes[static_cast<std::size_t>(s)]);
        for (int k = 0; k < problem.size; ++k) {
          for (int c = 0; c < stride; ++c) {
            for (int i = 0; i < problem.rows; ++i) {
              for (int e = 0; e <= k; ++e) {
                expected[static_cast<std::size_t>((target >> 1) * kQuad + k * stride + c)] +=
                    problem.J(s, factor, i, c) * problem.J(1, factor, i, e) * U_inv[k * kQuad + e];
              }
            }
          }
        }
      }
    }
    AlignedVector<double> Y(problem.y_size, 1e300);
    kernels().eliminate(problem.size, problem.factors, U_inv, Y.data());
    ExpectClose(Y, expected, 12.0 * problem.rows, kTolerance, what);
    AlignedVector<double> Y_generic(problem.y_size, -7.0);
    generic().eliminate(problem.size, problem.factors, U_inv, Y_generic.data());
    ExpectClose(Y, Y_generic, 12.0 * problem.rows, kTolerance, what + ", against generic");
  });
}

TEST_P(LandmarkKernels, GiveTheSameOfJacobiansByFactorInEitherPrecision) {
  ForAllSizes([&](const LandmarkCase& problem, const std::string& what) {
    const std::vector<double> values = random_.Vector(LandmarkCase::kNumQuads * kQuad);
    const std::vector<double> expected = Results(problem, problem.factors, values);
    const double scale = 54.0 * problem.rows;
    const ByFactor<double> in_double(problem);
    ExpectClose(Results(problem, in_double.factors, values), expected, scale, kTolerance, what);
    const ByFactor<float> in_single(problem);
    ExpectClose(Results(problem, in_single.factors, values), expected, scale, kTolerance,
                what + ", in single precision");
  });
}

// Landmarks of factors with a frame each, Jacobians by factor or, padded, in double. One of the
// factors has no frame that moves.
template <typename T>
struct CoupledCase {
  CoupledCase(int size, int frame_size, int rows, int landmark_slot, bool padded,
              test::Random* random)
      : sizes(2, static_cast<char>(size)) {
    const int columns[2] = {landmark_slot == 0 ? size : frame_size,
                            landmark_slot == 0 ? frame_size : size};
    const auto stride = [&](int s) { return padded ? PadToQuad(columns[s]) : columns[s]; };
    const std::ptrdiff_t factor_stride = PadToQuad(rows * (stride(0) + stride(1)));
    entries.assign(static_cast<std::size_t>(kNumFactors * factor_stride + kQuad), T{});
    std::ptrdiff_t begin = 0;
    for (int s = 0; s < 2; ++s) {
      for (int k = 0; k < kNumFactors * rows * columns[s]; ++k) {
        const int row = k / columns[s];
        entries[static_cast<std::size_t>(row / rows * factor_stride + begin +
                                         row % rows * stride(s) + k % columns[s])] =
            static_cast<T>(random->Unit());
      }
      SlotJacobians& slot =
          slots.emplace_back(SlotJacobians{nullptr, factor_stride, stride(s), columns[s]});
      if constexpr (std::is_same_v<T, float>) {
        slot.single = entries.data() + begin;
      } else {
        slot.data = entries.data() + begin;
      }
      begin += rows * stride(s);
    }
    offsets.assign(2 * kNumFactors, kNumFrames * PadToQuad(frame_size) / kQuad);
    for (int i = 0; i < kNumFactors; ++i) {
      offsets[static_cast<std::size_t>(2 * i + 1 - landmark_slot)] =
          i == 3 ? -1 : i % kNumFrames * PadToQuad(frame_size) / kQuad;
    }
    for (const int first : {0, 3}) {
      LandmarkFactors of_landmark;
      of_landmark.factors = list.data() + first;
      of_landmark.count = first == 0 ? 3 : kNumFactors - 3;
      of_landmark.residual_size = rows;
      of_landmark.landmark_slot = landmark_slot;
      of_landmark.num_slots = 2;
      of_landmark.jacobians = slots.data();
      of_landmark.tangent_offsets = offsets.data();
      factors.push_back(of_landmark);
    }
  }

  // y −= Σ J_fᵀ (J_f v) over the frames, by plain sums.
  void SubtractNormal(int rows, int landmark_slot, const AlignedVector<double>& v,
                      AlignedVector<double>* y) const {
    const SlotJacobians& J = slots[static_cast<std::size_t>(1 - landmark_slot)];
    for (int i = 0; i < kNumFactors; ++i) {
      const int offset = kQuad * offsets[static_cast<std::size_t>(2 * i + 1 - landmark_slot)];
      for (int r = 0; r < rows && offset >= 0; ++r) {
        const auto at = [&](int c) {
          const std::ptrdiff_t place = i * J.factor_stride + r * J.row_stride + c;
          return J.single != nullptr ? static_cast<double>(J.single[place]) : J.data[place];
        };
        double product = 0.0;
        for (int c = 0; c < J.columns; ++c) {
          product += at(c) * v[static_cast<std::size_t>(offset + c)];
        }
        for (int c = 0; c < J.columns; ++c) {
          (*y)[static_cast<std::size_t>(offset + c)] -= at(c) * product;
        }
      }
    }
  }

  static constexpr int kNumFactors = 7;
  static constexpr int kNumFrames = 3;
  std::vector<char> sizes;
  std::vector<std::int32_t> list = {4, 0, 6, 1, 5, 3, 2};
  std::vector<int> factors_begin = {0, 1, 2};
  AlignedVector<T> entries;
  std::vector<SlotJacobians> slots;
  std::vector<std::int32_t> offsets;
  std::vector<LandmarkFactors> factors;
};

// u = U_invᵀ U_inv w of a landmark.
AlignedVector<double> SolveFor(int size, const double* U_inv, const AlignedVector<double>& w) {
  AlignedVector<double> u(kQuad, 0.0);
  for (int r = 0; r < size; ++r) {
    for (int c = 0; c <= r; ++c) {
      for (int k = 0; k <= r; ++k) {
        u[static_cast<std::size_t>(k)] +=
            U_inv[r * kQuad + k] * U_inv[r * kQuad + c] * w[static_cast<std::size_t>(c)];
      }
    }
  }
  return u;
}

class CoupledKernels : public LandmarkKernels {
 protected:
  // Of the same factors, of whose landmarks nobody knows.
  template <typename T>
  void ExpectNormal(int frame_size, int rows, bool padded) {
    CoupledCase<T> problem(3, frame_size, rows, 1, padded, &random_);
    for (int i = 0; i < CoupledCase<T>::kNumFactors; ++i) {
      problem.offsets[static_cast<std::size_t>(2 * i + 1)] = -1;
    }
    const AlignedVector<double> v = PaddedRows(CoupledCase<T>::kNumFrames, frame_size);
    AlignedVector<double> y = PaddedRows(CoupledCase<T>::kNumFrames, frame_size);
    AlignedVector<double> expected = y;
    problem.SubtractNormal(rows, 1, v, &expected);
    FactorRows factors;
    factors.residual_size = rows;
    factors.num_slots = 2;
    factors.jacobians = problem.slots.data();
    factors.tangent_offsets = problem.offsets.data();
    kernels().subtract_normal(factors, problem.list.data(), CoupledCase<T>::kNumFactors, v.data(),
                              y.data());
    ExpectClose(
        y, expected, 50.0 * rows * frame_size, kTolerance,
        "frame size " + std::to_string(frame_size) + ", residual size " + std::to_string(rows));
  }

  template <typename T>
  void ExpectCoupled(int size, int frame_size, int rows, int landmark_slot, bool padded) {
    const CoupledCase<T> problem(size, frame_size, rows, landmark_slot, padded, &random_);
    const AlignedVector<double> U_inv = PaddedRows(8, size);  // the upper half is not read
    const AlignedVector<double> v = PaddedRows(CoupledCase<T>::kNumFrames, frame_size);
    const AlignedVector<double> start = PaddedRows(CoupledCase<T>::kNumFrames, frame_size);
    AlignedVector<double> expected = start;
    for (int l = 0; l < 2; ++l) {
      AlignedVector<double> w(kQuad, 0.0);
      const LandmarkFactors& factors = problem.factors[static_cast<std::size_t>(l)];
      generic().multiply_coupling(factors, v.data(), w.data());
      generic().add_coupling(factors, SolveFor(size, U_inv.data() + 16 * l, w).data(), nullptr,
                             expected.data());
    }
    problem.SubtractNormal(rows, landmark_slot, v, &expected);
    AlignedVector<double> y = start;
    AlignedVector<double> products(CoupledCase<T>::kNumFactors * 3, 0.0);
    const CoupledLandmarks landmarks{problem.factors_begin.data(), problem.factors.data(),
                                     problem.sizes.data(), U_inv.data(), 16};
    kernels().subtract_reduced(landmarks, 0, 2, v.data(), products.data(), y.data());
    ExpectClose(y, expected, 500.0 * rows * frame_size, kTolerance,
                "landmark size " + std::to_string(size) + ", frame size " +
                    std::to_string(frame_size) + ", residual size " + std::to_string(rows) +
                    ", slot " + std::to_string(landmark_slot));
  }
};

TEST_P(CoupledKernels, SubtractNormalIsAProductAndItsTranspose) {
  for (const int frame_size : {1, 3, 6, 7, 9, 15}) {
    for (const int rows : {1, 2, 3, 6, 7, 15}) {
      ExpectNormal<double>(frame_size, rows, /*padded=*/false);
      ExpectNormal<double>(frame_size, rows, /*padded=*/true);
      ExpectNormal<float>(frame_size, rows, /*padded=*/false);
      if (HasFatalFailure()) {
        return;
      }
    }
  }
}

TEST_P(CoupledKernels, SubtractReducedIsMultiplySolveAndSubtract) {
  for (const int size : {1, 3, 4}) {
    for (const int frame_size : {1, 3, 4, 6, 7, 8, 9, 12, 15}) {
      for (const int rows : {2, 3}) {
        for (const int landmark_slot : {0, 1}) {
          ExpectCoupled<double>(size, frame_size, rows, landmark_slot, /*padded=*/false);
          ExpectCoupled<double>(size, frame_size, rows, landmark_slot, /*padded=*/true);
          ExpectCoupled<float>(size, frame_size, rows, landmark_slot, /*padded=*/false);
          if (HasFatalFailure()) {
            return;
          }
        }
      }
    }
  }
}

INCERES_FOR_ALL_INSTRUCTION_SETS(CoupledKernels);

TEST_P(LandmarkKernels, GramLeavesEtaWithoutResiduals) {
  LandmarkCase problem(3, 2, &random_);
  problem.factors.residuals = nullptr;
  AlignedVector<double> P(16, 0.0), eta(kQuad, 7.0);
  kernels().landmark_gram(3, problem.factors, P.data(), eta.data());
  EXPECT_EQ(eta, AlignedVector<double>(kQuad, 7.0));
  EXPECT_GT(P[0], 0.0);
}

TEST_P(LandmarkKernels, EliminateWritesTheLastColumnApart) {
  for (const int frame_size : {5, 9, 13}) {
    for (int size = 1; size <= 4; ++size) {
      for (const int rows : kResidualSizes) {
        LandmarkCase problem(size, rows, &random_, {frame_size, frame_size, frame_size});
        const AlignedVector<double> U_inv = PaddedRows(4, size);  // the upper half is not read
        AlignedVector<double> padded(problem.y_size, 1e300);
        kernels().eliminate(size, problem.factors, U_inv.data(), padded.data());
        const int padded_quads = size * PadToQuad(frame_size) / kQuad;
        for (std::int32_t& target : problem.targets) {
          target = target < 0 ? target
                              : 2 * (target / 2 / padded_quads * QuadsWithTail(size, frame_size)) +
                                    target % 2;
        }
        problem.factors.y_tail = true;
        const AlignedVector<double> expected = WithTail(padded, size, frame_size);
        AlignedVector<double> Y(expected.size(), 1e300);
        kernels().eliminate(size, problem.factors, U_inv.data(), Y.data());
        const ByFactor<float> in_single(problem);
        AlignedVector<double> Y_of_singles(expected.size(), 1e300);
        kernels().eliminate(size, in_single.factors, U_inv.data(), Y_of_singles.data());
        ExpectClose(Y_of_singles, expected, 12.0 * rows, kTolerance, "in single precision");
        ExpectClose(Y, expected, 12.0 * rows, kTolerance,
                    "frames of " + std::to_string(frame_size) + ", landmark size " +
                        std::to_string(size) + ", residual size " + std::to_string(rows));
        if (HasFatalFailure()) {
          return;
        }
      }
    }
  }
}

// The landmark's own part of the vector is not read: it may be anything.
TEST_P(LandmarkKernels, MultiplyCouplingAddsWTransposedDelta) {
  ForAllSizes([&](const LandmarkCase& problem, const std::string& what) {
    std::vector<double> delta = random_.Vector(LandmarkCase::kNumQuads * kQuad);
    std::fill(delta.end() - kQuad, delta.end(), std::numeric_limits<double>::quiet_NaN());
    AlignedVector<double> w = PaddedRows(1, problem.size);
    AlignedVector<double> expected = w;
    for (const int factor : problem.seen) {
      for (int s = 0; s < 4; ++s) {
        const int offset = problem.tangent_offsets[static_cast<std::size_t>(factor * 4 + s)];
        if (s == LandmarkCase::kLandmarkSlot || offset < 0) {
          continue;
        }
        for (int i = 0; i < problem.rows; ++i) {
          for (int c = 0; c < problem.sizes[static_cast<std::size_t>(s)]; ++c) {
            for (int k = 0; k < problem.size; ++k) {
              expected[static_cast<std::size_t>(k)] +=
                  problem.J(1, factor, i, k) * problem.J(s, factor, i, c) *
                  delta[static_cast<std::size_t>(offset * kQuad + c)];
            }
          }
        }
      }
    }
    kernels().multiply_coupling(problem.factors, delta.data(), w.data());
    ExpectClose(w, expected, 54.0 * problem.rows, kTolerance, what);
  });
}

// uᵀ Wᵀ δ from either side; the landmark's own part of the vector is not written.
TEST_P(LandmarkKernels, AddCouplingIsTheTransposeOfMultiplyCoupling) {
  ForAllSizes([&](const LandmarkCase& problem, const std::string& what) {
    const AlignedVector<double> delta = PaddedRows(1, LandmarkCase::kNumQuads * kQuad);
    const AlignedVector<double> u = PaddedRows(1, problem.size);
    AlignedVector<double> w(kQuad, 0.0);
    kernels().multiply_coupling(problem.factors, delta.data(), w.data());
    AlignedVector<double> y(delta.size(), 0.0);
    std::fill(y.end() - kQuad, y.end(), 1e300);
    kernels().add_coupling(problem.factors, u.data(), nullptr, y.data());
    EXPECT_TRUE(std::all_of(y.end() - kQuad, y.end(), [](double entry) { return entry == 1e300; }))
        << what;
    const double by_w = std::inner_product(w.begin(), w.end(), u.begin(), 0.0);
    const double by_y = std::inner_product(y.begin(), y.end() - kQuad, delta.begin(), 0.0);
    EXPECT_NEAR(by_y, by_w, 54.0 * problem.rows * kTolerance * kQuad) << what;
  });
}

TEST_P(LandmarkKernels, BackSubstituteSubtractsYTransposedDelta) {
  for (int size = 1; size <= 4; ++size) {
    for (int frame_size = 1; frame_size <= 16; ++frame_size) {
      const int stride = PadToQuad(frame_size);
      const AlignedVector<double> Y = PaddedRows(6 * size, frame_size);
      const AlignedVector<double> delta = PaddedRows(8, frame_size);
      std::vector<Incidence> incidences;
      std::vector<double> y = random_.Vector(4);
      std::vector<double> expected = y;
      for (const int frame : {5, 0, 7}) {
        const int block = frame % 6;
        incidences.push_back(
            {block * size * stride / kQuad, frame * stride / kQuad, stride / kQuad});
        for (int k = 0; k < size; ++k) {
          for (int c = 0; c < frame_size; ++c) {
            expected[static_cast<std::size_t>(k)] -=
                Y[static_cast<std::size_t>((block * size + k) * stride + c)] *
                delta[static_cast<std::size_t>(frame * stride + c)];
          }
        }
      }
      kernels().back_substitute(size, incidences.data(), 3, Y.data(), delta.data(), y.data());
      ExpectClose(
          y, expected, 3.0 * frame_size, kTolerance,
          "landmark size " + std::to_string(size) + ", frame size " + std::to_string(frame_size));
      if (HasFatalFailure()) {
        return;
      }
    }
  }
}

TEST_P(LandmarkKernels, SubtractIncidencesIsTheTransposeOfBackSubstitute) {
  for (int size = 1; size <= 4; ++size) {
    for (int frame_size = 1; frame_size <= 16; ++frame_size) {
      const int stride = PadToQuad(frame_size);
      const AlignedVector<double> Y = PaddedRows(6 * size, frame_size);
      const std::vector<double> v = random_.Vector(4);
      AlignedVector<double> y = PaddedRows(8, frame_size);
      AlignedVector<double> expected = y;
      std::vector<Incidence> incidences;
      for (const int frame : {5, 0, 7}) {
        const int block = frame % 6;
        incidences.push_back(
            {block * size * stride / kQuad, frame * stride / kQuad, stride / kQuad});
        for (int k = 0; k < size; ++k) {
          for (int c = 0; c < frame_size; ++c) {
            expected[static_cast<std::size_t>(frame * stride + c)] -=
                Y[static_cast<std::size_t>((block * size + k) * stride + c)] *
                v[static_cast<std::size_t>(k)];
          }
        }
      }
      kernels().subtract_incidences(size, incidences.data(), 3, Y.data(), v.data(), y.data());
      ExpectClose(
          y, expected, 4.0, kTolerance,
          "landmark size " + std::to_string(size) + ", frame size " + std::to_string(frame_size));
      if (HasFatalFailure()) {
        return;
      }
    }
  }
}

INCERES_FOR_ALL_INSTRUCTION_SETS(LandmarkKernels);

}  // namespace
}  // namespace inceres::internal
