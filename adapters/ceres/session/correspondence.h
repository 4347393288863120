#pragma once

#include <memory>
#include <vector>

#include "adapters/ceres/read/index.h"
#include "adapters/ceres/read/introspection.h"
#include "adapters/ceres/session/remembering_family.h"
#include "inceres/problem/factor_graph.h"

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

}  // namespace inceres::internal
