#pragma once

/// Solves a small problem in the way of that name and prints all that Ceres tells of it but times,
/// so that two runs can be compared line by line; then, to stderr, how often inceres has solved, if
/// it is there. 0, or 2 for a name that is none.
extern "C" [[gnu::visibility("default")]] int SolveInWay(const char* way);
