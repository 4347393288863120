#pragma once

#include <map>
#include <memory>
#include <vector>

#include "inceres/factors/diagonal_prior.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/summary.h"
#include "support/random_values.h"
#include "support/test_families.h"

namespace inceres::test {

/// What EditAtRandom does.
enum class EditKind {
  kGrow,          ///< a frame with landmarks, or a landmark seen from both ends
  kSlide,         ///< the oldest frame and landmarks go, new ones come
  kRemove,        ///< landmarks and now and then a frame
  kViews,         ///< views go
  kPin,           ///< a prior that outweighs all else comes or goes
  kLosses,        ///< of views
  kMeasurements,  ///< of views
  kValues,        ///< of a variable, constant or not
  kConstants,     ///< variables are held, or go on
  kBounds,        ///< come and go
  kGroups,        ///< of a frame, which may be new
};

/// A bundle of frames (6) and landmarks (3) that an IncrementalSolver follows, and a plain record
/// of what it is made of, from which the same problem can be built anew for the batch solver.
class IncrementalBundle {
 public:
  explicit IncrementalBundle(const IncrementalOptions& options, unsigned seed = 1);

  // Changes of the edit under construction.

  /// A frame with a prior, tied to the one before it.
  VariableId AddFrame();
  /// A landmark seen from these frames.
  VariableId AddLandmark(const std::vector<VariableId>& frames,
                         std::shared_ptr<const Loss> loss = nullptr);
  /// A prior at a random place.
  FactorId AddPrior(VariableId frame, double sqrt_information);
  void RemoveVariable(VariableId id);
  void RemoveFactor(FactorId id);
  void SetConstant(VariableId id, bool constant);
  void SetLoss(FactorId id, std::shared_ptr<const Loss> loss);
  /// Another random measurement.
  void ChangeMeasurement(FactorId id);
  void SetValues(VariableId id, const std::vector<double>& values);
  /// Empty: none on that side.
  void SetBounds(VariableId id, const std::vector<double>& lower, const std::vector<double>& upper);
  /// Bounds that many of the variables will meet, on one in so many of these: on one side or on
  /// both, near where they are.
  void BoundSome(const std::vector<VariableId>& ids, int one_in);
  GraphEdit& edit() { return edit_; }

  /// Carries the edit out and begins the next.
  void Apply();
  /// Frames and landmarks at once: `views` neighboring frames see each.
  void Grow(int num_frames, int num_landmarks, int views,
            std::shared_ptr<const Loss> loss = nullptr);
  /// A change of one of these kinds, to one thing or to many, carried out. New views have this
  /// loss.
  void EditAtRandom(const std::vector<EditKind>& kinds,
                    const std::shared_ptr<const Loss>& loss = nullptr);

  /// A batch solve of the problem as recorded, from the values held now, or from those the
  /// variables came with.
  Summary SolveInBatch(bool from_values_held) const;
  /// The recorded problem at the values held.
  FactorGraph Graph() const {
    FactorGraph graph;
    Rebuild(/*from_values_held=*/true, &graph);
    return graph;
  }
  /// The cost another IncrementalSolver finds, which never knew what was removed; from the values
  /// that the variables came with, or from those held now.
  double FreshMinimum(const IncrementalOptions& options, bool from_values_held = false) const;

  const std::vector<VariableId>& frames() const { return frames_; }
  const std::vector<VariableId>& landmarks() const { return landmarks_; }
  /// Views only.
  std::vector<FactorId> Views() const;
  int num_factors() const { return static_cast<int>(factors_.size()); }
  Random& random() { return random_; }
  /// All values held now, variable by variable.
  std::vector<double> Values() const;

  IncrementalSolver solver;

 private:
  enum Kind { kPrior, kTie, kView };
  struct Variable {
    Role role;
    bool constant = false;
    std::vector<double> start;
    std::vector<double> lower;
    std::vector<double> upper;
  };
  struct Factor {
    Kind kind;
    std::vector<VariableId> variables;
    std::shared_ptr<const Loss> loss;
    DiagonalPriorFamily::Measurement prior;
    SmoothFamily::Measurement smooth;
  };

  using Key = std::pair<FamilyId, int>;

  VariableId AddVariable(Role role, int size);
  VariableId Any(const std::vector<VariableId>& ids) {
    return ids[static_cast<std::size_t>(random_.Below(static_cast<int>(ids.size())))];
  }
  VariableId AnyVariable() { return Any(random_.Below(2) > 0 ? frames_ : landmarks_); }
  std::vector<FactorId> SomeViews();
  void RemoveSome();
  void PinOrLetGo();
  void SetSomeValues();
  void HoldOrFreeSome();
  FactorId Add(Factor factor);
  SmoothFamily::Measurement RandomMeasurement(const SmoothFamily& family);
  /// The recorded problem in a graph of its own; ids[new] = old.
  void Rebuild(bool from_values_held, FactorGraph* graph) const;

  Random random_;
  FamilyHandle<DiagonalPriorFamily> priors_;
  FamilyHandle<SmoothFamily> ties_;
  FamilyHandle<SmoothFamily> views_;
  GraphEdit edit_;
  std::vector<VariableId> frames_;
  std::vector<VariableId> landmarks_;
  std::map<VariableId, Variable> variables_;
  std::map<Key, Factor> factors_;
};

/// How many values lie on a bound. Beyond it there is none.
int CountOnBounds(const FactorGraph& graph);

}  // namespace inceres::test
