#pragma once

/// The release these headers are of; a test holds them against the project's version in CMake. For
/// code that compiles with several releases:
///
///     #if INCERES_VERSION_MAJOR > 0 || INCERES_VERSION_MINOR >= 2
///
/// Until 1.0 a new minor release may change the API, a patch does not.
#define INCERES_VERSION_MAJOR 0
/// The second number of the version.
#define INCERES_VERSION_MINOR 1
/// The third number of the version.
#define INCERES_VERSION_PATCH 0
/// The version as text.
#define INCERES_VERSION_STRING "0.1.0"
