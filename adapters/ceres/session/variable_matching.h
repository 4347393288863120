#pragma once

#include <memory>
#include <vector>

#include "adapters/ceres/plan/landmark_selection.h"
#include "adapters/ceres/read/ceres_adapters.h"
#include "adapters/ceres/read/factor_shapes.h"
#include "adapters/ceres/read/index.h"
#include "adapters/ceres/read/introspection.h"
#include "adapters/ceres/session/remembering_family.h"
#include "inceres/ceres/solve.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/problem/graph_edit.h"
#include "inceres/solver/incremental_solver.h"

namespace inceres::internal {

/// How much an IncrementalProblem keeps.
enum class Trust {
  kNothing,  ///< solved once: nothing is kept to be recognized
  /// a cost function is taken for the one of the last solve if it evaluates to the same residual
  kVerified,
  kAddresses,  ///< … if it has the same address
};

/// Which variable of a graph stands for which parameter block, and which factor for which residual
/// block, of the problem last followed.
struct Correspondence {
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
    int family = -1;             // into families
    FactorId id;
    int first_variable = 0;  // into factor_variables
  };
  struct Family {
    std::shared_ptr<RememberingFamily> family;
    int landmark_slot = -1;
    FamilyId id = -1;
  };

  std::vector<Family> families;  // all there ever were

  std::vector<Variable> variables;
  std::vector<Factor> factors;  // those that stayed, then those that came, both in program order
  std::vector<VariableId> factor_variables;
  std::vector<int> variable_of;  // per block: into variables, or -1
  std::vector<int> factor_of;    // per residual block: into factors, or -1

  /// Of a block that has one.
  const Variable& VariableOf(int block) const { return variables[At(variable_of[At(block)])]; }
};

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

/// ∂(x ⊞ δ)/∂δ; empty if there is none.
std::vector<double> ReadPlusJacobian(const UserManifold& manifold, const double* x);

/// What a problem looks like this time.
struct ProblemNow {
  const ProblemView& view;
  const ShapeTable& shapes;
  const LandmarkSelection& landmarks;
  bool landmarks_given;  ///< by the user
};

/// The parameter blocks' half of following a problem: those that were known are matched with those
/// that are there, what is gone is removed, and what is new is added, all in one edit.
class VariableMatching {
 public:
  /// Chooses the roles. `known` is what was known, and becomes what is.
  VariableMatching(const ProblemNow& now, Trust trust, const IncrementalSolver& solver,
                   GraphEdit* edit, Correspondence* known, ProblemChanges* changes);

  const std::vector<Role>& roles() const { return roles_; }

  /// What was known stays or goes.
  void Match();
  /// Whether a variable that was known goes.
  bool Goes(VariableId id) const { return going_[At(id)] != 0; }
  /// Whether the caller has set the block to other values.
  bool IsRevalued(int block) const { return revalued_[At(known_.variable_of[At(block)])] != 0; }
  /// The blocks of these residual blocks that are not known yet.
  void AddThoseOf(const std::vector<int>& residuals);

 private:
  bool IsSame(const Correspondence::Variable& variable, const ParameterBlockView& block,
              Role role) const;
  const double* StartOf(const ParameterBlockView& block);
  bool FollowBounds(const ParameterBlockView& block, Correspondence::Variable* variable);
  void TakeOver(int b, Correspondence::Variable variable);
  void Keep(int b, Correspondence::Variable variable, bool revalued);
  void Add(int b, Role role);

  const ProblemView& view_;
  const Trust trust_;
  const IncrementalSolver& solver_;
  GraphEdit& edit_;
  Correspondence& known_;
  ProblemChanges& changes_;
  std::vector<Role> roles_;     // per block
  std::vector<char> revalued_;  // per entry of known_.variables
  std::vector<char> going_;     // per variable id
  std::vector<double> start_;   // StartOf
  ManifoldTable manifolds_;
};

}  // namespace inceres::internal
