#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <unordered_set>
#include <utility>
#include <vector>

#include "adapters/ceres/plan/adapter_cache.h"
#include "adapters/ceres/plan/landmark_selection.h"
#include "adapters/ceres/read/ceres_adapters.h"
#include "adapters/ceres/read/factor_shapes.h"
#include "adapters/ceres/read/introspection.h"
#include "adapters/ceres/read/loss_table.h"
#include "adapters/ceres/read/pointer_index.h"
#include "adapters/ceres/session/incremental_roles.h"
#include "adapters/ceres/session/remembering_family.h"
#include "inceres/ceres/solve.h"
#include "inceres/problem/graph_edit.h"
#include "inceres/solver/incremental_solver.h"

namespace inceres::internal {

/// What a problem looks like this time.
struct ProblemNow {
  const ProblemView& view;
  const ShapeTable& shapes;
  const LandmarkSelection& landmarks;
  bool landmarks_given;  ///< by the user
};

/// How much a IncrementalProblem keeps.
enum class Trust {
  kNothing,    ///< solved once: nothing is kept to be recognized
  kVerified,   ///< a cost function is taken for the one of the last solve if it evaluates to the same residual
  kAddresses,  ///< … if it has the same address
};

/// An IncrementalSolver that follows a ceres::Problem: it knows which variable stands for which parameter block, which factor for
/// which residual block, and turns what has changed into one edit. (The rules of recognition are in inceres/ceres/session.h.)
///
/// In the graph are the residual blocks that touch a variable block, and those that did so once and have since become constant.
class IncrementalProblem {
 public:
  IncrementalProblem(const IncrementalOptions& options, Trust trust) : solver_(options), edit_(solver_.graph()), trust_(trust) {
    solver_.SetVariableNames([this](VariableId id) { return NameOf(id); });
  }
  IncrementalProblem(const IncrementalProblem&) = delete;
  IncrementalProblem& operator=(const IncrementalProblem&) = delete;

  /// Brings the solver's graph to where the problem is. After an error the object is of no more use.
  Status Follow(const ProblemNow& now, ProblemChanges* changes);
  IncrementalSolver& solver() { return solver_; }
  /// Whether this residual block of the view last followed is in the graph: then its cost is part of the solver's.
  bool Holds(std::size_t residual) const { return factor_of_[residual] >= 0; }
  /// Current number of variable landmarks of the problem.
  int num_landmarks() const { return num_landmarks_; }

  /// user memory := what the solver found, for the blocks it moves.
  void WriteToUser(const ProblemView& view) const;
  /// After a successful Update: takes the proofs by which Follow will recognize what it meets again.
  void Remember();

  void Forget(const ceres::CostFunction* cost) { forgotten_.insert(cost); }
  void Forget(const ceres::LossFunction* loss) { losses_.Forget(loss); }

 private:
  struct Variable {
    VariableId id = -1;
    double* user = nullptr;
    const UserManifold* manifold = nullptr;
    int ambient_size = 0;
    int tangent_size = 0;
    Role role = Role::kFrame;
    bool constant = false;
    std::vector<double> plus_jacobian;  // at the solver's values; empty without a manifold or a proof
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
    std::vector<FactorFamily::Slot> slots;
    int landmark_slot = -1;
    FamilyId id = -1;
  };
  // A residual block that is new to the graph; by landmark (index into variables_; after all others if there is none), then in
  // program order.
  struct NewFactor {
    int landmark = -1;
    int residual = -1;
    bool operator<(const NewFactor& other) const {
      return landmark != other.landmark ? landmark < other.landmark : residual < other.residual;
    }
  };

  std::string NameOf(VariableId id) const;
  void ChooseRoles(const ProblemNow& now);
  void ChooseFamilies(const ProblemNow& now);
  int FamilyOf(const FactorShape& shape, int landmark_slot);
  void MatchVariables(const ProblemView& view, ProblemChanges* changes);
  bool IsSame(const Variable& variable, const ParameterBlockView& block, Role role) const;
  void TakeOver(const ParameterBlockView& block, int b, Variable variable, ProblemChanges* changes);
  void MatchFactors(const ProblemView& view, ProblemChanges* changes);
  int FindOld(ceres::ResidualBlockId block);
  bool HasSameVariables(const Factor& factor, const ProblemView& view, const ResidualBlockView& residual) const;
  void Keep(const ProblemView& view, const ResidualBlockView& residual, Factor factor, ProblemChanges* changes);
  bool MustLinearize(const Factor& factor, const ProblemView& view, const ResidualBlockView& residual);
  void RemoveRest(ProblemChanges* changes);
  void AddVariables(const ProblemView& view, ProblemChanges* changes);
  void AddVariable(const ParameterBlockView& block, int b, ProblemChanges* changes);
  void AddFactors(const ProblemView& view, ProblemChanges* changes);
  void AddFactor(const ProblemView& view, int r, ProblemChanges* changes);
  bool IsLandmark(int b) const { return roles_[static_cast<std::size_t>(b)] == Role::kLandmark; }

  IncrementalSolver solver_;
  GraphEdit edit_;
  const Trust trust_;
  LossTable losses_;
  std::unordered_set<const ceres::CostFunction*> forgotten_;

  std::vector<Family> families_;
  std::vector<Variable> variables_;
  std::vector<Factor> factors_;  // in the program order of the problem last followed
  std::vector<VariableId> factor_variables_;
  int num_landmarks_ = 0;

  // Of the Follow under way; kept for their memory.
  std::vector<Variable> old_variables_;
  std::vector<Factor> old_factors_;
  std::vector<VariableId> old_factor_variables_;
  std::vector<int> variable_of_;      // per block: into variables_, or -1
  std::vector<int> factor_of_;        // per residual block: into factors_, or -1
  std::vector<char> revalued_;        // per entry of variables_
  std::vector<char> seen_;            // per old factor
  std::vector<char> going_;           // per variable id
  std::vector<PastRole> past_roles_;  // per block
  std::vector<Role> roles_;           // per block
  std::vector<int> family_of_;        // per residual block: into families_; -1 if fixed
  std::vector<int> family_at_;        // per place of the shapes, as ChooseFamilies numbers them
  std::vector<NewFactor> new_factors_;
  AdapterCache<Manifold, CeresManifold, UserManifold> manifolds_;
  std::vector<ceres::ResidualBlockId> old_blocks_;
  PointerIndex old_index_;
  bool old_index_built_ = false;
  std::size_t next_old_ = 0;
};

}  // namespace inceres::internal
