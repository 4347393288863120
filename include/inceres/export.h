#pragma once

/// Marks what the library exports; everything else is compiled with hidden visibility.
#define INCERES_EXPORT __attribute__((visibility("default")))
