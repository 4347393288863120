#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "inceres/problem/losses.h"
#include "inceres/problem/manifolds.h"
#include "storage/built_in.h"

namespace inceres::internal {

// The formats of the built-in manifolds and losses: a name, and what the constructor takes. Names
// stay as they are, for files have them. Manifolds within a product, and losses within a loss, have
// formats of their own, null included, and GraphFormats limits how deep these go. A loss that is
// read computes what the one that was written did, since everything else it holds follows from its
// parameters.

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

// What a parameter of a loss must be. Losses take any parameters; those that a reader refuses are
// not written in the first place.
struct Rule {
  bool may_be_zero;
  const char* what;
  const char* must;
};
constexpr Rule kScale = {false, "a scale", "positive and finite"};
// A weight of 0 switches a factor off.
constexpr Rule kWeight = {true, "a weight", "finite and not negative"};

bool Holds(const Rule& rule, double value) {
  return (rule.may_be_zero ? value >= 0.0 : value > 0.0) && std::isfinite(value);
}

std::string Broken(const Rule& rule, double value) {
  return std::string(rule.what) + " is " + std::to_string(value) + " but must be " + rule.must;
}

void WriteParameter(const Rule& rule, double value, GraphWriter* writer) {
  if (!Holds(rule, value)) {
    writer->Fail(Broken(rule, value));
  }
  writer->WriteDouble(value);
}

// After a failure every read gives 0: 1 in its place lets the object be made, which the failed load
// then throws away.
double ReadParameter(const Rule& rule, GraphReader* reader) {
  const double value = reader->ReadDouble();
  if (!Holds(rule, value)) {
    reader->Fail(Broken(rule, value));
  }
  return reader->ok() ? value : 1.0;
}

// Huber, soft-L1, Cauchy, arctan and Tukey are made with one number each.
template <typename L>
void AddScaled(const char* name, GraphFormats* formats) {
  formats->AddLoss<L>(
      std::string("inceres.") + name,
      [](const L& loss, GraphWriter* writer) { WriteParameter(kScale, loss.a(), writer); },
      [](GraphReader* reader) { return std::make_shared<L>(ReadParameter(kScale, reader)); });
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

void AddBuiltInLosses(GraphFormats* formats) {
  AddScaled<HuberLoss>("huber_loss", formats);
  AddScaled<SoftLOneLoss>("soft_l_one_loss", formats);
  AddScaled<CauchyLoss>("cauchy_loss", formats);
  AddScaled<ArctanLoss>("arctan_loss", formats);
  AddScaled<TukeyLoss>("tukey_loss", formats);
  formats->AddLoss<TolerantLoss>(
      "inceres.tolerant_loss",
      [](const TolerantLoss& loss, GraphWriter* writer) {
        WriteParameter(kScale, loss.a(), writer);
        WriteParameter(kScale, loss.b(), writer);
      },
      [](GraphReader* reader) {
        // By itself and not as an argument: the order in which arguments are evaluated is the
        // compiler's.
        const double a = ReadParameter(kScale, reader);
        return std::make_shared<TolerantLoss>(a, ReadParameter(kScale, reader));
      });
  // A null inner loss is the identity, and so has a meaning: a weight on the squared norm.
  formats->AddLoss<ScaledLoss>(
      "inceres.scaled_loss",
      [](const ScaledLoss& loss, GraphWriter* writer) {
        writer->WriteLoss(loss.loss());
        WriteParameter(kWeight, loss.scale(), writer);
      },
      [](GraphReader* reader) {
        const std::shared_ptr<const Loss> loss = reader->ReadLoss();
        return std::make_shared<ScaledLoss>(loss, ReadParameter(kWeight, reader));
      });
  // f(g(s)): the outer one first, in the file as in the constructor.
  formats->AddLoss<ComposedLoss>(
      "inceres.composed_loss",
      [](const ComposedLoss& loss, GraphWriter* writer) {
        writer->WriteLoss(loss.f());
        writer->WriteLoss(loss.g());
      },
      [](GraphReader* reader) {
        const std::shared_ptr<const Loss> f = reader->ReadLoss();
        return std::make_shared<ComposedLoss>(f, reader->ReadLoss());
      });
}

}  // namespace inceres::internal
