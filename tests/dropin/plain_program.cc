// A program that knows nothing but Ceres: what a user has.
#include "dropin/plain_ways.h"

int main(int argc, char** argv) {
  return SolveInWay(argc == 2 ? argv[1] : "");
}
