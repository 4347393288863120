#include "tools/sim/collection_view.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <utility>

namespace inceres::internal {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr int kCamerasPerSight = 100;
constexpr double kPopularityExponent = 0.8;
constexpr double kPitch = 60.0;  // from sight to sight
constexpr double kHeight = 25.0;
constexpr double kRange = 150.0;        // what is farther is not seen
constexpr double kAfar = 1.0 / 6.0;     // the share of photos from afar
constexpr double kCosGrazing = 0.25;    // a surface that is turned away more is not seen
constexpr double kHalfImage = 512.0;    // pixels, the longer half
constexpr double kMedianFocal = 700.0;  // pixels
constexpr int kMaxTries = 400;

}  // namespace

CollectionView::CollectionView(int num_cameras, std::uint64_t seed)
    : sights_(static_cast<std::size_t>(std::max(1, num_cameras / kCamerasPerSight))) {
  Random random(seed, 1);
  PlaceSights(&random);
  // Sight i has rank n − i: cumulated shares, and each camera draws.
  std::vector<double> shares(sights_.size());
  for (std::size_t i = 0; i < shares.size(); ++i) {
    shares[i] =
        PortableExp(-kPopularityExponent * PortableLog(static_cast<double>(shares.size() - i)));
  }
  std::partial_sum(shares.begin(), shares.end(), shares.begin());
  for (int i = 0; i < num_cameras; ++i) {
    const double draw = random.Uniform() * shares.back();
    const auto found = std::upper_bound(shares.begin(), shares.end() - 1, draw);
    AddCamera(static_cast<int>(found - shares.begin()), &random);
  }
  CollectViewers();
}

// On the crossings of a square grid, shuffled, so that neighbors are not of like rank.
void CollectionView::PlaceSights(Random* random) {
  const int side = static_cast<int>(std::ceil(std::sqrt(static_cast<double>(sights_.size()))));
  std::vector<int> places(sights_.size());
  std::iota(places.begin(), places.end(), 0);
  for (std::size_t i = places.size() - 1; i > 0; --i) {
    std::swap(places[i], places[static_cast<std::size_t>(random->Below(static_cast<int>(i) + 1))]);
  }
  for (std::size_t i = 0; i < sights_.size(); ++i) {
    const double x = random->Uniform(-10.0, 10.0), z = random->Uniform(-10.0, 10.0);
    const int column = places[i] % side, row = places[i] / side;
    sights_[i].center = {kPitch * column + x, 0.0, -kPitch * row + z};
    sights_[i].radius = random->Uniform(6.0, 12.0);
  }
}

void CollectionView::AddCamera(int sight, Random* random) {
  const Sight& target = sights_[static_cast<std::size_t>(sight)];
  const double azimuth = random->Uniform(-kPi, kPi);
  const bool afar = random->Uniform() < kAfar;
  const double spread = PortableExp(0.4 * std::clamp(random->Normal(), -2.0, 2.0));
  const double distance = target.radius + (afar ? 55.0 : 20.0) * spread;
  const double height = 1.6 + 0.3 * random->Normal();
  SimulatedCamera camera;
  camera.center = target.center +
                  Vector3{distance * PortableSin(azimuth), height, distance * PortableCos(azimuth)};
  const double up = PortableAtan2(random->Uniform(2.0, 14.0), distance);
  const double yaw = azimuth + 0.1 * random->Normal();
  const double roll = 0.05 * random->Normal();
  camera.R =
      (Rotation::AboutAxis(1, yaw) * Rotation::AboutAxis(0, up) * Rotation::AboutAxis(2, roll))
          .Inverse();
  const double zoom = PortableExp(0.35 * std::clamp(random->Normal(), -2.0, 2.0));
  camera.focal = kMedianFocal * (afar ? 0.8 : 1.0) * zoom;
  camera.k1 = -0.05 + 0.02 * random->Normal();
  camera.k2 = 0.01 + 0.005 * random->Normal();
  Image image{kHalfImage / camera.focal, 0.75 * kHalfImage / camera.focal};
  if (random->Uniform() < 0.25) {  // upright
    std::swap(image.half_width, image.half_height);
  }
  cameras_.push_back(camera);
  images_.push_back(image);
  sight_of_.push_back(sight);
}

// Who is pointed at a sight, or has its middle in the image.
void CollectionView::CollectViewers() {
  for (std::size_t i = 0; i < cameras_.size(); ++i) {
    for (std::size_t s = 0; s < sights_.size(); ++s) {
      const Vector3 ray = sights_[s].center + Vector3{0.0, 0.5 * kHeight, 0.0} - cameras_[i].center;
      const Vector3 p = cameras_[i].R * ray;
      const double depth = -p[2];
      const bool in_image = Dot(ray, ray) < kRange * kRange && depth > sights_[s].radius &&
                            std::abs(p[0]) <= images_[i].half_width * depth &&
                            std::abs(p[1]) <= images_[i].half_height * depth;
      if (in_image || static_cast<int>(s) == sight_of_[i]) {
        sights_[s].viewers.push_back(static_cast<int>(i));
      }
    }
  }
}

bool CollectionView::Sees(int camera, const Vector3& position, const Vector3& normal) const {
  const SimulatedCamera& seeing = cameras_[static_cast<std::size_t>(camera)];
  const Image& image = images_[static_cast<std::size_t>(camera)];
  const Vector3 ray = position - seeing.center;
  const double toward = -Dot(ray, normal);
  if (toward <= 0.0 || toward * toward < kCosGrazing * kCosGrazing * Dot(ray, ray)) {
    return false;
  }
  const Vector3 p = seeing.R * ray;
  const double depth = -p[2];
  return depth >= kMinDepth && std::abs(p[0]) <= image.half_width * depth &&
         std::abs(p[1]) <= image.half_height * depth;
}

bool CollectionView::RandomPosition(int camera, Random* random, Vector3* position,
                                    Vector3* normal) const {
  const Sight& sight = sights_[static_cast<std::size_t>(SightOf(camera))];
  const Vector3 from = cameras_[static_cast<std::size_t>(camera)].center - sight.center;
  const double toward = PortableAtan2(from[0], from[2]);
  for (int attempt = 0; attempt < kMaxTries; ++attempt) {
    const double azimuth = toward + random->Uniform(-1.3, 1.3);
    const double height = random->Uniform(0.0, kHeight);
    const double radius = sight.radius * random->Uniform(1.0, 1.15);  // what stands out
    *normal = {PortableSin(azimuth), 0.0, PortableCos(azimuth)};
    *position = sight.center + radius * *normal + Vector3{0.0, height, 0.0};
    if (Sees(camera, *position, *normal)) {
      return true;
    }
  }
  return false;
}

}  // namespace inceres::internal
