#pragma once

#include <memory>

#include "inceres/io/read_options.h"
#include "inceres/problem/losses.h"

namespace inceres {

/// What readers take that make factors of a file's measurements.
struct GraphReadOptions {
  ReadOptions file;                  ///< of the reader of the file
  std::shared_ptr<const Loss> loss;  ///< of every factor that is a measurement; null: ½‖f‖²
};

}  // namespace inceres
