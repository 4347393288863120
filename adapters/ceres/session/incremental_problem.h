#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <unordered_set>
#include <vector>

#include "adapters/ceres/plan/landmark_selection.h"
#include "adapters/ceres/read/ceres_adapters.h"
#include "adapters/ceres/read/factor_shapes.h"
#include "adapters/ceres/read/introspection.h"
#include "adapters/ceres/session/remembering_family.h"
#include "inceres/ceres/solve.h"
#include "inceres/problem/graph_edit.h"
#include "inceres/solver/incremental_solver.h"

namespace inceres::internal {

/// What a block was in the last solve.
enum class PastRole : char { kNone, kFrame, kLandmark };

/// Roles of the parameter blocks in a solve that follows another. To change a role costs as much as
/// to remove the block and add it anew, so roles are sticky: landmarks stay landmarks as long as no
/// two meet in a residual block, and frames become landmarks when the selection makes them so. With
/// `given` (by the user) the selection rules alone, but for constants, which keep their roles.
///
/// Requires that no two blocks of the selection meet in a residual block. Cost: linear in slots.
std::vector<Role> ChooseIncrementalRoles(const ProblemView& view,
                                         const LandmarkSelection& selection, bool given,
                                         const std::vector<PastRole>& past);

/// What a problem looks like this time.
struct ProblemNow {
  const ProblemView& view;
  const ShapeTable& shapes;
  const LandmarkSelection& landmarks;
  bool landmarks_given;  ///< by the user
};

/// How much an IncrementalProblem keeps.
enum class Trust {
  kNothing,  ///< solved once: nothing is kept to be recognized
  /// a cost function is taken for the one of the last solve if it evaluates to the same residual
  kVerified,
  kAddresses,  ///< … if it has the same address
};

/// An IncrementalSolver that follows a ceres::Problem: it knows which variable stands for which
/// parameter block, which factor for which residual block, and turns what has changed into one
/// edit. (The rules of recognition are in inceres/ceres/session.h.)
///
/// In the graph are the residual blocks that touch a variable block, and those that did so once and
/// have since become constant.
class IncrementalProblem {
 public:
  IncrementalProblem(const IncrementalOptions& options, Trust trust)
      : solver_(options), edit_(solver_.graph()), trust_(trust) {
    solver_.SetVariableNames([this](VariableId id) { return NameOf(id); });
  }
  IncrementalProblem(const IncrementalProblem&) = delete;
  IncrementalProblem& operator=(const IncrementalProblem&) = delete;

  /// Brings the solver's graph to where the problem is. After an error the object is of no more
  /// use.
  Status Follow(const ProblemNow& now, ProblemChanges* changes);
  IncrementalSolver& solver() { return solver_; }
  /// Whether this residual block of the view last followed is in the graph: then its cost is part
  /// of the solver's.
  bool Holds(std::size_t residual) const { return factor_of_[residual] >= 0; }
  /// Current number of variable landmarks of the problem.
  int num_landmarks() const { return num_landmarks_; }

  /// user memory := what the solver found, for the blocks it moves.
  void WriteToUser(const ProblemView& view) const;
  /// CeresSession::Covariance, of the problem last followed.
  Status Covariance(const std::vector<const double*>& parameter_blocks,
                    const LiveCovarianceOptions& options, LiveCovariance* covariance) const;
  /// After a successful Update: takes the proofs by which Follow will recognize what it meets
  /// again.
  void Remember();

  void Forget(const ceres::CostFunction* cost) { forgotten_.insert(cost); }
  void Forget(const ceres::LossFunction* loss) { losses_.Forget(loss); }

 private:
  class Follower;
  struct Variable {
    VariableId id = -1;
    double* user = nullptr;
    const UserManifold* manifold = nullptr;
    int ambient_size = 0;
    int tangent_size = 0;
    Role role = Role::kFrame;
    bool constant = false;
    bool selects = false;        // in the graph it is on a SubsetManifold instead of the user's
    std::vector<double> bounds;  // lower, then upper; empty without any
    // at the solver's values; empty without a manifold or a proof
    std::vector<double> plus_jacobian;
  };
  struct Factor {
    ceres::ResidualBlockId block = nullptr;
    const ceres::CostFunction* cost = nullptr;
    const Loss* loss = nullptr;  // the adapter; the graph keeps it alive
    int family = -1;             // into families_
    FactorId id;
    int first_variable = 0;  // into factor_variables_
  };
  struct Family {
    std::shared_ptr<RememberingFamily> family;
    int landmark_slot = -1;
    FamilyId id = -1;
  };

  std::string NameOf(VariableId id) const;
  static std::vector<double> ReadPlusJacobian(const UserManifold& manifold, const double* x);

  IncrementalSolver solver_;
  GraphEdit edit_;  // of Follow, which uses its memory again
  const Trust trust_;
  LossTable losses_;
  std::unordered_set<const ceres::CostFunction*> forgotten_;
  std::vector<Family> families_;

  // Of the problem last followed.
  std::vector<Variable> variables_;
  std::vector<Factor> factors_;  // those that stayed, then those that came, both in program order
  std::vector<VariableId> factor_variables_;
  std::vector<int> variable_of_;  // per block: into variables_, or -1
  std::vector<int> factor_of_;    // per residual block: into factors_, or -1
  int num_landmarks_ = 0;
};

}  // namespace inceres::internal
