#pragma once

#include <cstdint>

#include "linear/block_rows.h"

namespace inceres::internal {

/// What somebody who follows the rows of an S that is edited has seen of them.
class SeenRows {
 public:
  /// Whether all rows that were there at the last call, for the same S, are as they were: then only
  /// new ones are to be looked at.
  bool OnlyGrew(const SymmetricBlockRows& S) {
    const bool only_grew = &S == S_ && S.resized_version() == version_;
    S_ = &S;
    version_ = S.resized_version();
    return only_grew;
  }
  /// Nothing has been seen.
  void Forget() { S_ = nullptr; }

 private:
  const SymmetricBlockRows* S_ = nullptr;
  std::int64_t version_ = 0;
};

}  // namespace inceres::internal
