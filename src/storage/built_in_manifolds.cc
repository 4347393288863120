#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "inceres/problem/manifolds.h"
#include "inceres/problem/similarity_manifold.h"
#include "storage/built_in.h"

namespace inceres::internal {

// The formats of the built-in manifolds: a name, and what the constructor takes. Names stay as they
// are, for files have them. Manifolds within a product have formats of their own, and GraphFormats
// limits how deep these go.

namespace {

// A manifold without parameters.
template <typename M>
void AddPlainManifold(const char* name, GraphFormats* formats) {
  formats->AddManifold<M>(
      std::string("inceres.") + name, [](const M&, GraphWriter*) {},
      [](GraphReader*) { return std::make_shared<M>(); });
}

// One that is its ambient size. Up to 2³⁰, as the products below; nothing is allocated for it.
template <typename M>
void AddSized(const char* name, GraphFormats* formats) {
  formats->AddManifold<M>(
      std::string("inceres.") + name,
      [](const M& manifold, GraphWriter* writer) { writer->WriteInt(manifold.AmbientSize()); },
      [](GraphReader* reader) {
        return std::make_shared<M>(reader->ReadIntIn(1, 1 << 30, "a manifold's size"));
      });
}

// A byte a coordinate, so that a size is as large as what is read for it.
void WriteSubset(const SubsetManifold& manifold, GraphWriter* writer) {
  const std::vector<int>& free = manifold.free_indices();
  // '\1' where the coordinate moves: the complement of what the constructor takes.
  std::string moves(static_cast<std::size_t>(manifold.AmbientSize()), '\0');
  for (const int k : free) {
    moves[static_cast<std::size_t>(k)] = '\1';
  }
  writer->WriteString(moves);
}

// The length of the string is the ambient size. Any byte but zero moves.
std::shared_ptr<SubsetManifold> ReadSubset(GraphReader* reader) {
  const std::string moves = reader->ReadString();
  std::vector<int> constant;
  for (std::size_t k = 0; k < moves.size(); ++k) {
    if (moves[k] == '\0') {
      constant.push_back(static_cast<int>(k));
    }
  }
  return std::make_shared<SubsetManifold>(static_cast<int>(moves.size()), constant);
}

void WriteProduct(const ProductManifold& manifold, GraphWriter* writer) {
  // Their number, and each with its format.
  writer->WriteLong(static_cast<std::int64_t>(manifold.components().size()));
  for (const std::shared_ptr<const Manifold>& component : manifold.components()) {
    writer->WriteManifold(component.get());
  }
}

std::shared_ptr<ProductManifold> ReadProduct(GraphReader* reader) {
  // At least a byte each must be left.
  const std::size_t count = reader->ReadCount(1);
  std::vector<std::shared_ptr<const Manifold>> components;
  std::int64_t size = 0;
  for (std::size_t k = 0; k < count && reader->ok(); ++k) {
    components.push_back(reader->ReadManifold());
    // In 64 bits: components of allowed sizes may exceed an int together.
    size += components.back() != nullptr ? components.back()->AmbientSize() : 0;
  }
  if (size > (1 << 30)) {
    reader->Fail("a product of too many values");
  }
  // After a failure components may be null: no product is made of them.
  return reader->ok() ? std::make_shared<ProductManifold>(std::move(components)) : nullptr;
}

}  // namespace

void AddBuiltInManifolds(GraphFormats* formats) {
  AddSized<EuclideanManifold>("euclidean_manifold", formats);
  AddSized<SphereManifold>("sphere_manifold", formats);
  AddPlainManifold<QuaternionManifold>("quaternion_manifold", formats);
  AddPlainManifold<EigenQuaternionManifold>("eigen_quaternion_manifold", formats);
  AddPlainManifold<RotationQuaternionManifold>("rotation_quaternion_manifold", formats);
  AddPlainManifold<PoseManifold>("pose_manifold", formats);
  AddPlainManifold<LeftPoseManifold>("left_pose_manifold", formats);
  AddPlainManifold<SE3Manifold>("se3_manifold", formats);
  AddPlainManifold<SE2Manifold>("se2_manifold", formats);
  AddPlainManifold<SimilarityManifold>("similarity_manifold", formats);
  formats->AddManifold<SubsetManifold>("inceres.subset_manifold", WriteSubset, ReadSubset);
  formats->AddManifold<ProductManifold>("inceres.product_manifold", WriteProduct, ReadProduct);
}

}  // namespace inceres::internal
