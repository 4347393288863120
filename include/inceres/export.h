#pragma once

/// Marks what the library exports; everything else is compiled with hidden visibility.
#define INCERES_EXPORT [[gnu::visibility("default")]]
