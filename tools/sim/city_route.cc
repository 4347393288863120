#include "tools/sim/city_route.h"

#include <algorithm>
#include <array>
#include <cstddef>

namespace inceres::internal {
namespace {

constexpr double kHalfPi = 1.57079632679489661923;
constexpr double kMaxRadius = 8.0;  // of a corner

// One step to the north, west, south, east.
Crossing Step(const Crossing& from, int heading) {
  constexpr int kColumns[] = {0, -1, 0, 1}, kRows[] = {1, 0, -1, 0};
  return {from.column + kColumns[heading], from.row + kRows[heading]};
}

Vector3 Direction(int heading) {
  const Crossing step = Step({}, heading);
  return {static_cast<double>(step.column), 0.0, -static_cast<double>(step.row)};
}

// Which way to go at each crossing: never back, less often where one has been, and rather straight
// on.
class Driver {
 public:
  Driver(const CityGrid& grid, Random* random)
      : grid_(grid), random_(random), visits_(static_cast<std::size_t>(grid.num_crossings())) {}

  // The change of heading, −1, 0 or 1, in quarters to the left.
  int Turn(const Crossing& at, int heading) {
    std::array<double, 3> weights{};  // to the right, straight on, to the left
    double sum = 0.0;
    for (std::size_t i = 0; i < weights.size(); ++i) {
      const int to = (heading + static_cast<int>(i) + 3) % 4;
      if (grid_.Contains(Step(at, to))) {
        const double visited = Visits(at, to);
        weights[i] = (i == 1 ? 2.0 : 1.0) / (1.0 + 20.0 * visited * visited);
        sum += weights[i];
      }
    }
    double left = sum * random_->Uniform();
    std::size_t chosen = 0;
    while (chosen < 2 && left >= weights[chosen]) {
      left -= weights[chosen];
      ++chosen;
    }
    while (weights[chosen] == 0.0) {  // by rounding only
      --chosen;
    }
    const int turn = static_cast<int>(chosen) - 1;
    Visits(at, (heading + turn + 4) % 4) += 1.0;
    return turn;
  }

 private:
  // Of the street that leads from a crossing: it belongs to its southern or western end.
  double& Visits(const Crossing& at, int heading) {
    const Crossing owner = heading == 1 || heading == 2 ? Step(at, heading) : at;
    return visits_[static_cast<std::size_t>(grid_.Index(owner))][heading % 2];
  }

  const CityGrid& grid_;
  Random* random_;
  std::vector<std::array<double, 2>> visits_;
};

}  // namespace

CityRoute::CityRoute(const CityGrid& grid, double length, Random* random)
    : radius_(std::min(kMaxRadius, 0.5 * grid.street_width())) {
  Driver driver(grid, random);
  Crossing at{};
  int heading = 0;
  Add(grid.pitch() - radius_, grid.Place(at), heading, 0);
  while (length_ < length) {
    at = Step(at, heading);
    const int turn = driver.Turn(at, heading);
    const Vector3 corner = grid.Place(at) - radius_ * Direction(heading);
    Add(turn == 0 ? 2.0 * radius_ : kHalfPi * radius_, corner, heading, turn);
    heading = (heading + turn + 4) % 4;
    Add(grid.pitch() - 2.0 * radius_, grid.Place(at) + radius_ * Direction(heading), heading, 0);
  }
}

void CityRoute::Add(double length, const Vector3& start, int heading, int turn) {
  pieces_.push_back({length_, start, heading, turn});
  length_ += length;
}

const CityRoute::Piece& CityRoute::PieceAt(double s) const {
  const auto after =
      std::upper_bound(pieces_.begin(), pieces_.end(), s,
                       [](double value, const Piece& piece) { return value < piece.begin; });
  return after == pieces_.begin() ? *after : *(after - 1);
}

Vector3 CityRoute::Position(double s) const {
  const Piece& piece = PieceAt(s);
  const double along = s - piece.begin;
  const Vector3 ahead = Direction(piece.heading);
  if (piece.turn == 0) {
    return piece.start + along * ahead;
  }
  const Vector3 aside = Direction((piece.heading + piece.turn + 4) % 4);
  const double angle = along / radius_;
  return piece.start + (radius_ * PortableSin(angle)) * ahead +
         (radius_ * (1.0 - PortableCos(angle))) * aside;
}

double CityRoute::Heading(double s) const {
  const Piece& piece = PieceAt(s);
  return kHalfPi * piece.heading + piece.turn * (s - piece.begin) / radius_;
}

}  // namespace inceres::internal
