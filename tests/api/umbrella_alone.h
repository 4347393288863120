#pragma once

namespace inceres::test {

/// The cost that a program finds which knows inceres/inceres.h alone.
double CostByUmbrellaAlone();

}  // namespace inceres::test
