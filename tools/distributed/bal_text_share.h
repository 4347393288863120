#pragma once

#include <cstdint>
#include <string>

#include "io/bal_binary.h"

namespace inceres::tools {

// False: the file cannot be read, or not all is as it should be. What is wrong, and where, is for
// ReadBal to say, which reads all of it.

/// Numbers in the text of such a file.
std::int64_t NumTokens(const internal::BalCounts& counts);

/// The counts at the head of a BAL text, and the size of the file.
bool ReadBalCounts(const std::string& path, internal::BalCounts* counts, std::int64_t* file_bytes);

/// How many numbers begin in the bytes [begin, end) of a file.
bool CountTokens(const std::string& path, std::int64_t begin, std::int64_t end,
                 std::int64_t* num_tokens);

/// Reads the observations, cameras and points whose first number is one of the `num_tokens` numbers
/// that begin at or behind the byte `begin`, of which the first is the `first_token`-th of the
/// file: so all shares of a file together have each of them once. Memory: that of the share. After
/// a failure *share may be half filled.
bool ReadBalShare(const std::string& path, const internal::BalCounts& counts, std::int64_t begin,
                  std::int64_t first_token, std::int64_t num_tokens, internal::BalShare* share);

}  // namespace inceres::tools
