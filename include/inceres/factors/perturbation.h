#pragma once

namespace inceres {

/// On which side a rotation is perturbed: which manifold the poses of a factor are on.
enum class Perturbation : unsigned char {
  kRight,  ///< R Exp(φ): PoseManifold; VINS, XRSLAM
  kLeft,   ///< Exp(φ) R: LeftPoseManifold; OKVIS
};

}  // namespace inceres
