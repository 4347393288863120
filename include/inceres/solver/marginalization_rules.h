#pragma once

#include <vector>

#include "inceres/export.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/solver/marginalization.h"

namespace inceres {

/// Which landmarks go with the frames that leave a window: three rules of known estimators, as requests to Marginalize. None of
/// them changes anything.
///
/// A frame is whatever does not have the role of a landmark: the poses, velocities and biases of one image are given together.
/// "Seen by" a frame: some factor touches both. What is constant or borrowed among the landmarks stays where it is.
/// Cost: the factors of the frames given and of the landmarks they see; a pass over a copy of the graph if it does not track its
/// variables' factors yet, which after the first Marginalize it does.

/// The oldest frame leaves with all landmarks it sees: every factor of it goes into the prior. Landmarks with fewer than
/// min_factors factors (2 or more views, for a landmark and not just its ray) are dropped instead.
/// Source: VINS-Mono's MARGIN_OLD (Qin, Li & Shen, "VINS-Mono: A robust and versatile monocular visual-inertial state estimator",
/// 2018, section VI-C).
INCERES_EXPORT MarginalizationRequest OldestFrameRule(const FactorGraph& graph, const std::vector<VariableId>& frames,
                                                      int min_factors = 2);

/// A frame leaves that is too like its neighbors to be worth its linearization: factors that tie it to landmarks are dropped,
/// and landmarks that have no others with them; what else touches it (the prior, preintegrated motion) is marginalized. Source:
/// VINS-Mono's MARGIN_SECOND_NEW.
INCERES_EXPORT MarginalizationRequest SecondNewestFrameRule(const FactorGraph& graph, const std::vector<VariableId>& frames);

/// Landmarks the leaving frames see: one that a frame of `newest` sees too stays, and its factors with the leaving frames are
/// dropped, so that it stays out of the prior; any other is marginalized, or dropped if it has fewer than min_factors factors. A
/// landmark all of whose factors touch a leaving frame, as an inverse depth does whose anchor leaves, cannot stay.
/// Source: Leutenegger et al., "Keyframe-based visual–inertial odometry using nonlinear optimization", 2015, section 3.5 (OKVIS's
/// applyMarginalizationStrategy).
INCERES_EXPORT MarginalizationRequest KeyframeRule(const FactorGraph& graph, const std::vector<VariableId>& leaving,
                                                   const std::vector<VariableId>& newest, int min_factors = 2);

}  // namespace inceres
