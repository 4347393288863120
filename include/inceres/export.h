#pragma once

/// Marks what the shared libraries export; everything else is compiled with hidden visibility. In
/// inceres::internal it marks what one of them calls of another, no promise to anyone else.
#define INCERES_EXPORT [[gnu::visibility("default")]]

/// Marks a class inside an exported one that is nobody's business: it is not exported with it.
#define INCERES_HIDDEN [[gnu::visibility("hidden")]]
