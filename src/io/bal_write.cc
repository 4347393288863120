#include <climits>
#include <cmath>
#include <memory>
#include <string>

#include "inceres/io/bal.h"
#include "io/bal_binary.h"
#include "io/byte_stream.h"
#include "io/text_writer.h"

// Checks and writes BAL problems. Validate is the one place that says what a well-formed problem
// is; WriteBal, the binary writer and AddBal rely on it and check nothing again. Numbers are
// written by std::to_chars in their shortest form that reads back as the same double: a problem
// that is written and read has the same bits, and locales have no say.

namespace inceres {
namespace internal {
namespace {

// "BalProblem: …": the argument at fault is a struct, and no file has a part in it yet.
Status InvalidProblem(const std::string& what) {
  return Status::Error(StatusCode::kInvalidArgument, "BalProblem: " + what);
}

Status CheckIndex(std::size_t observation, const char* field, int index, int size) {
  if (index >= 0 && index < size) {
    return Status::Ok();
  }
  return InvalidProblem("observations[" + std::to_string(observation) + "]." + field + " is " +
                        std::to_string(index) + ", not between 0 and " + std::to_string(size - 1));
}

// The size first: the loop runs over what is expected.
Status CheckValues(const char* field, const std::vector<double>& values, int count, int size) {
  const std::size_t expected = static_cast<std::size_t>(count) * static_cast<std::size_t>(size);
  if (values.size() != expected) {
    return InvalidProblem(std::string(field) + " has " + std::to_string(values.size()) +
                          " values instead of " + std::to_string(expected));
  }
  for (std::size_t i = 0; i < expected; ++i) {
    if (!std::isfinite(values[i])) {
      return InvalidProblem(std::string(field) + "[" + std::to_string(i) + "] is not finite");
    }
  }
  return Status::Ok();
}

}  // namespace
}  // namespace internal

// In the order of the struct, and the first fault is what is reported. Counts before indices, which
// are held against them; the number of observations is limited to what an int counts, as factors
// are numbered by ints.
Status BalProblem::Validate() const {
  if (num_cameras < 1 || num_points < 1) {
    return internal::InvalidProblem("needs at least one camera and one point, has " +
                                    std::to_string(num_cameras) + " and " +
                                    std::to_string(num_points));
  }
  if (observations.empty() || observations.size() > INT_MAX) {
    return internal::InvalidProblem("has " + std::to_string(observations.size()) +
                                    " observations, not between 1 and " + std::to_string(INT_MAX));
  }
  // One pass over the observations, cheap beside any use that is made of them.
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const BalObservation& observation = observations[i];
    if (Status status = internal::CheckIndex(i, "camera", observation.camera, num_cameras);
        !status.ok()) {
      return status;
    }
    if (Status status = internal::CheckIndex(i, "point", observation.point, num_points);
        !status.ok()) {
      return status;
    }
    if (!std::isfinite(observation.x) || !std::isfinite(observation.y)) {
      return internal::InvalidProblem("observations[" + std::to_string(i) + "] is not finite");
    }
  }
  if (Status status = internal::CheckValues("cameras", cameras, num_cameras, kCameraSize);
      !status.ok()) {
    return status;
  }
  return internal::CheckValues("points", points, num_points, kPointSize);
}

// Nothing is opened for a problem that is not valid: an existing file of that name stays.
Status WriteBal(const std::string& path, const BalProblem& problem) {
  if (Status status = problem.Validate(); !status.ok()) {
    return status;
  }
  // By the name, as ReadBal chooses.
  if (internal::IsBalBinary(path)) {
    return internal::WriteBalBinary(path, problem);
  }
  // Declared before the writer, which refers to it. If the writer fails, the sink is destroyed
  // without Finish, and removes its partial file.
  std::unique_ptr<internal::ByteSink> sink;
  if (Status status = internal::OpenByteSink(path, &sink); !status.ok()) {
    return status;
  }
  internal::TextWriter writer(sink.get());
  // The writer keeps its first error and goes on quietly: Finish returns it.
  writer.Put(problem.num_cameras, ' ');
  writer.Put(problem.num_points, ' ');
  writer.Put(problem.observations.size(), '\n');
  for (const BalObservation& observation : problem.observations) {
    writer.Put(observation.camera, ' ');
    writer.Put(observation.point, ' ');
    writer.Put(observation.x, ' ');
    writer.Put(observation.y, '\n');
  }
  // One number a line, as the data sets of the paper's authors have them.
  for (const std::vector<double>* values : {&problem.cameras, &problem.points}) {
    for (const double value : *values) {
      writer.Put(value, '\n');
    }
  }
  return writer.Finish();
}

}  // namespace inceres
