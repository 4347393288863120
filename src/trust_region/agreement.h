#pragma once

#include <functional>
#include <vector>

#include "inceres/solver/callbacks.h"
#include "inceres/status.h"

namespace inceres::internal {

/// What the loop decides by, where several processes minimize one cost, each with factors and
/// variables of its own: values that are the same, to the bit, in all of them, or one would go on
/// and wait forever for another that has stopped. As it is: one process, which agrees with itself.
///
/// Every call is made by all processes, in the same order.
class Agreement {
 public:
  using Evaluation = std::function<Status(double* cost)>;

  virtual ~Agreement() = default;

  /// Evaluates what is here. *cost: the sum of all processes. A failure anywhere is one everywhere.
  virtual Status Evaluate(const Evaluation& evaluation, double* cost) const {
    return evaluation(cost);
  }
  /// Whether it is so everywhere.
  virtual bool All(bool own) const { return own; }
  /// Of all processes.
  virtual double Sum(double own) const { return own; }
  virtual double Max(double own) const { return own; }
  /// Asks those who observe here. The verdict that goes farthest is everybody's.
  virtual ObserverAction Ask(const std::function<ObserverAction()>& observers) const {
    return observers();
  }
  /// Whether a variable, by its position in the layout, is another process's to count: several
  /// have it.
  bool CountsElsewhere(std::size_t position) const {
    return position < counted_elsewhere_.size() && counted_elsewhere_[position] != 0;
  }

 protected:
  std::vector<char> counted_elsewhere_;  // of the first variables of the layout
};

}  // namespace inceres::internal
