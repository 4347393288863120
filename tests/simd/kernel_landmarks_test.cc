// The kernels of the elimination and of the way back against plain loops: landmark sizes 1 to 4,
// residuals from 1 to beyond a slice, several slots of different sizes, a frame that is touched
// twice, a slot without a frame.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

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
          values[static_cast<std::size_t>(r * PadToQuad(slot_size) + c)] = random->Unit();
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

class LandmarkKernels : public KernelTest {
 protected:
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
    kernels().add_coupling(problem.factors, u.data(), y.data());
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
