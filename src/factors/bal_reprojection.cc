#include "inceres/factors/bal_reprojection.h"

#include <cmath>
#include <cstdint>
#include <cstring>
#include <memory>
#include <vector>

#include "inceres/problem/ambient_family.h"
#include "inceres/problem/rotation.h"

// BAL's camera model: P = Exp(w) X + t, p = −P_xy / P_z, residual = f (1 + k1 r² + k2 r⁴) p − (x,
// y). The camera looks along −z, so 1/P_z comes with a minus throughout.
//
// The sine and cosine of w are the same for all factors of a camera, so rotations are kept for the
// duration of one call. A rotation is computed from w alone, by one function, so a factor has the
// same bits whichever factors are evaluated along with it. NaN and infinity are found in sums over
// what was written: a sum is finite only if all its terms are, and one test a factor is cheaper
// than one an entry.

namespace inceres {
namespace {

constexpr int kCameraSize = 9;
constexpr int kPointSize = 3;

struct CameraRotation {
  double R[9];    // Exp(w)
  double J_l[9];  // left Jacobian: ∂(Exp(w) X)/∂w = −[Exp(w) X]× J_l
};

// Jacobians need J_l as well, from the same two values of sine and cosine: RotationPolynomial with
// the coefficients shifted by one. Smooth at w = 0, where CoefficientsOfAngle uses series.
template <bool kWithJacobians>
void ComputeRotation(const double* w, CameraRotation& rotation) {
  const RotationCoefficients k = CoefficientsOfAngle(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
  RotationPolynomial(w, k.sinc, k.cosc, rotation.R);
  if (kWithJacobians) {
    RotationPolynomial(w, k.cosc, k.sinq, rotation.J_l);
  }
}

// For few factors: remembers the rotation of the last camera. As the cache below, valid for one
// Evaluate call.
template <bool kWithJacobians>
class LastRotation {
 public:
  const CameraRotation& Get(const double* camera) {
    if (camera_ != camera) {
      camera_ = camera;
      ComputeRotation<kWithJacobians>(camera, rotation_);
    }
    return rotation_;
  }

 private:
  const double* camera_ = nullptr;
  CameraRotation rotation_ = {};
};

// Remembers the rotations of the cameras seen last, so that most factors need no sine.
// Direct-mapped by address and valid for one Evaluate call only: parameters do not change within a
// call, but may between calls.
template <bool kWithJacobians>
class RotationCache {
 public:
  const CameraRotation& Get(const double* camera) {
    // Fibonacci hashing: cameras lie at regular distances in the state, and a product spreads those
    // evenly.
    const std::uint64_t hash =
        (reinterpret_cast<std::uintptr_t>(camera) >> 3) * std::uint64_t{0x9E3779B97F4A7C15};
    const std::size_t entry = static_cast<std::size_t>(hash >> (64 - kBits));
    if (keys_[entry] != camera) {
      keys_[entry] = camera;
      ComputeRotation<kWithJacobians>(camera, rotations_[entry]);
    }
    return rotations_[entry];
  }

 private:
  static constexpr int kBits = 7;

  const double* keys_[1 << kBits] = {};
  CameraRotation rotations_[1 << kBits];  // not initialized: an entry is read after its key was set
};

// For large families, whose cameras come back from call to call: remembers rotations by the bits of
// w, for as long as the thread lives. What is found is what would be computed, whenever that was.
class KeptRotations {
 public:
  // Memory of a thread's own, from the first large family it evaluates on.
  static KeptRotations& OfThread() {
    thread_local const std::unique_ptr<KeptRotations> kKept = std::make_unique<KeptRotations>();
    return *kKept;
  }

  KeptRotations() {
    // Equal to no bits of an angle that gives a finite rotation.
    std::memset(static_cast<void*>(entries_), 0xff, sizeof(entries_));
  }

  const CameraRotation& Get(const double* camera) {
    Bits w;
    std::memcpy(&w, camera, sizeof(w));
    const std::uint64_t mixed =
        ((w.bits[0] * kMultiplier ^ w.bits[1]) * kMultiplier ^ w.bits[2]) * kMultiplier;
    Entry& entry = entries_[mixed >> (64 - kBits)];
    if (std::memcmp(&entry.w, &w, sizeof(w)) != 0) {
      entry.w = w;
      ComputeRotation<true>(camera, entry.rotation);
    }
    return entry.rotation;
  }

 private:
  static constexpr int kBits = 11;
  static constexpr std::uint64_t kMultiplier = 0x9E3779B97F4A7C15;

  struct Bits {
    std::uint64_t bits[3];
  };
  struct Entry {
    Bits w;
    CameraRotation rotation;
  };
  Entry entries_[1 << kBits];
};

// As the memories of one call.
class RotationsOfThread {
 public:
  const CameraRotation& Get(const double* camera) { return kept_.Get(camera); }

 private:
  KeptRotations& kept_ = KeptRotations::OfThread();
};

// The values of one projection that both the residual and the Jacobians need.
struct Projection {
  double Y[3];  // R X
  double minus_inverse_depth;
  double p[2];
  double r2;
  double distortion;
};

// One division a factor; all else is products. A depth of zero makes the residual infinite, which
// the caller finds.
inline Projection Project(const CameraRotation& rotation, const double* camera, const double* X) {
  Projection v;
  MultiplyMatrixVector(rotation.R, X, v.Y);
  v.minus_inverse_depth = -1.0 / (v.Y[2] + camera[5]);
  v.p[0] = (v.Y[0] + camera[3]) * v.minus_inverse_depth;
  v.p[1] = (v.Y[1] + camera[4]) * v.minus_inverse_depth;
  v.r2 = v.p[0] * v.p[0] + v.p[1] * v.p[1];
  v.distortion = 1.0 + v.r2 * (camera[7] + camera[8] * v.r2);
  return v;
}

// A[r] = ∂residual_r/∂P. With D = 1 + k1 r² + k2 r⁴ and D' = dD/d(r²):
//     ∂residual/∂p = f (D I + 2 D' p pᵀ),   ∂p/∂P = −1/P_z [I | p].
inline void DifferentiateProjection(const Projection& v, const double* camera, double A[2][3]) {
  // f is camera[6], k1 and k2 are camera[7] and [8].
  const double f = camera[6];
  const double two_slope = 2.0 * (camera[7] + 2.0 * camera[8] * v.r2);
  // f · (−1/P_z) is in all six entries, and the 2×2 block is symmetric: A = scale (D I + 2 D' p pᵀ)
  // [I | p].
  const double scale = f * v.minus_inverse_depth;
  const double diagonal = scale * v.distortion;
  const double s0 = scale * two_slope * v.p[0];
  const double s1 = scale * two_slope * v.p[1];
  A[0][0] = diagonal + s0 * v.p[0];
  A[0][1] = A[1][0] = s0 * v.p[1];
  A[1][1] = diagonal + s1 * v.p[1];
  A[0][2] = A[0][0] * v.p[0] + A[0][1] * v.p[1];
  A[1][2] = A[1][0] * v.p[0] + A[1][1] * v.p[1];
}

// row = aᵀ M for a row-major 3×3 matrix; returns the sum of the entries, which is finite only if
// all are.
inline double MultiplyRow(const double a[3], const double M[9], double* row) {
  const double r0 = a[0] * M[0] + a[1] * M[3] + a[2] * M[6];
  const double r1 = a[0] * M[1] + a[1] * M[4] + a[2] * M[7];
  const double r2 = a[0] * M[2] + a[1] * M[5] + a[2] * M[8];
  row[0] = r0;
  row[1] = r1;
  row[2] = r2;
  return r0 + r1 + r2;
}

// One row of the camera's Jacobian: a = ∂residual_r/∂P, and aᵀ(−[Y]×) J_l = (Y × a)ᵀ J_l.
inline double WriteCameraRow(const Projection& v, const CameraRotation& rotation, double f,
                             const double a[3], double p, double* row) {
  double torque[3];
  Cross(v.Y, a, torque);
  double sum = MultiplyRow(torque, rotation.J_l, row);
  // ∂P/∂t = I, so the columns of t are a itself. Those of f, k1, k2 are D p, f r² p, f r⁴ p.
  row[3] = a[0];
  row[4] = a[1];
  row[5] = a[2];
  row[6] = v.distortion * p;
  row[7] = f * v.r2 * p;
  row[8] = row[7] * v.r2;
  sum += (a[0] + a[1] + a[2]) + (row[6] + row[7] + row[8]);
  return sum;
}

// Where a formula writes the ambient Jacobian of a slot: at its destination if the tangent map is
// the identity.
struct Target {
  Target(const TangentMap& tangent_map, const JacobianView& view, int factor, double* scratch,
         int ambient_size)
      : map(tangent_map),
        destination(view.data + factor * view.factor_stride),
        destination_stride(view.row_stride) {
    // Any other map needs the whole ambient Jacobian in scratch memory before it is projected.
    const bool direct = map.kind == TangentMap::Kind::kIdentity;
    ambient = direct ? destination : scratch;
    ambient_stride = direct ? destination_stride : ambient_size;
  }
  bool wanted() const { return map.wanted(); }
  void Finish() const {
    if (ambient != destination) {
      ProjectToTangentSpace(map, ambient, 2, destination, destination_stride);
    }
  }

  const TangentMap& map;
  double* destination;
  double* ambient;
  int destination_stride;
  int ambient_stride;
};

// Returns a sum over the Jacobian entries written, which is finite only if all are.
inline double WriteJacobians(const FactorBatch& batch, int i, const Projection& v,
                             const CameraRotation& rotation, const double* camera) {
  double A[2][3];
  DifferentiateProjection(v, camera, A);
  // The sum is over ambient entries, before the projection: one that is not finite fails even in a
  // column that the map leaves out.
  double sum = 0.0;
  // One scratch for both slots: each is finished before the next one begins.
  double scratch[2 * kCameraSize];
  const TangentMap* const* maps = batch.tangent_maps + 2 * static_cast<std::ptrdiff_t>(i);
  const Target camera_target(*maps[0], batch.jacobians[0], i, scratch, kCameraSize);
  if (camera_target.wanted()) {
    sum += WriteCameraRow(v, rotation, camera[6], A[0], v.p[0], camera_target.ambient);
    sum += WriteCameraRow(v, rotation, camera[6], A[1], v.p[1],
                          camera_target.ambient + camera_target.ambient_stride);
    camera_target.Finish();
  }
  const Target point_target(*maps[1], batch.jacobians[1], i, scratch, kPointSize);
  if (point_target.wanted()) {
    // ∂P/∂X = R.
    sum += MultiplyRow(A[0], rotation.R, point_target.ambient);
    sum += MultiplyRow(A[1], rotation.R, point_target.ambient + point_target.ambient_stride);
    point_target.Finish();
  }
  return sum;
}

// The cache pays from a few factors on: it is 19 KiB to clear in part and to spread over.
constexpr int kFewFactors = 8;
// From so many on, cameras of a family are mostly not those of the factors just before.
constexpr std::size_t kManyFactors = 1 << 15;

// Points that are asked for before they are come to: those of one camera lie anywhere.
constexpr int kPointsAhead = 12;

// One loop, compiled six times: with or without Jacobians, and with each memory of rotations.
template <bool kWithJacobians, typename Rotations>
EvaluationFailure EvaluateWith(const BalReprojectionFamily::Measurement* measurements,
                               const FactorBatch& batch) {
  Rotations rotations;
  for (int i = batch.begin; i < batch.end; ++i) {
    const double* camera = batch.parameters[2 * static_cast<std::ptrdiff_t>(i)];
    const double* X = batch.parameters[2 * static_cast<std::ptrdiff_t>(i) + 1];
    if (i + kPointsAhead < batch.end) {
      __builtin_prefetch(batch.parameters[2 * static_cast<std::ptrdiff_t>(i + kPointsAhead) + 1]);
    }
    const CameraRotation& rotation = rotations.Get(camera);
    const Projection v = Project(rotation, camera, X);
    double* residual = batch.residuals + 2 * static_cast<std::ptrdiff_t>(i);
    const double focal = camera[6] * v.distortion;
    residual[0] = focal * v.p[0] - measurements[i].x;
    residual[1] = focal * v.p[1] - measurements[i].y;
    // One test for both: infinities of opposite sign sum to NaN, which is not finite either.
    if (!std::isfinite(residual[0] + residual[1])) {
      const bool in_plane = v.Y[2] + camera[5] == 0.0;
      return {i, in_plane ? "the point lies in the camera's plane (depth 0)"
                          : "a residual is not finite"};
    }
    if (kWithJacobians && !std::isfinite(WriteJacobians(batch, i, v, rotation, camera))) {
      return {i, "a Jacobian entry is not finite"};
    }
  }
  return {};
}

// The choice changes the time, never the result.
template <bool kWithJacobians>
EvaluationFailure EvaluateRange(const std::vector<BalReprojectionFamily::Measurement>& measurements,
                                const FactorBatch& batch) {
  if (batch.end - batch.begin < kFewFactors) {
    return EvaluateWith<kWithJacobians, LastRotation<kWithJacobians>>(measurements.data(), batch);
  }
  return measurements.size() < kManyFactors
             ? EvaluateWith<kWithJacobians, RotationCache<kWithJacobians>>(measurements.data(),
                                                                           batch)
             : EvaluateWith<kWithJacobians, RotationsOfThread>(measurements.data(), batch);
}

}  // namespace

BalReprojectionFamily::BalReprojectionFamily(int camera_tangent_size, int point_tangent_size)
    : MeasuredFamily(2, {{kCameraSize, camera_tangent_size}, {kPointSize, point_tangent_size}}) {
}

EvaluationFailure BalReprojectionFamily::Evaluate(const FactorBatch& batch) const {
  return batch.jacobians == nullptr ? EvaluateRange<false>(measurements(), batch)
                                    : EvaluateRange<true>(measurements(), batch);
}

}  // namespace inceres
