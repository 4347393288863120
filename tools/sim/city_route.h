#pragma once

#include <vector>

#include "tools/sim/city_grid.h"

namespace inceres::internal {

/// A drive through the city along the middle of its streets, around corners in quarter circles.
class CityRoute {
 public:
  /// At least `length` meters. Begins at the first crossing.
  CityRoute(const CityGrid& grid, double length, Random* random);

  /// Where one is after s meters, 0 .. length, on the ground.
  Vector3 Position(double s) const;
  /// Rotation about y that turns −z into the direction of travel.
  double Heading(double s) const;

 private:
  // A straight line, or a quarter circle where turn is 1, to the left, or −1.
  struct Piece {
    double begin = 0.0;  // of s
    Vector3 start{};
    int heading = 0;  // at the start, in quarter turns to the left from the north
    int turn = 0;
  };

  void Add(double length, const Vector3& start, int heading, int turn);
  const Piece& PieceAt(double s) const;

  double radius_;
  double length_ = 0.0;
  std::vector<Piece> pieces_;
};

}  // namespace inceres::internal
