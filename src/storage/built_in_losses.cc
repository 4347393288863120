#include <cmath>
#include <memory>
#include <string>

#include "inceres/problem/losses.h"
#include "storage/built_in.h"

// The formats of the built-in losses: the parameters that each was made with, and for losses of
// losses the inner ones by their own formats, with a name each (graph_formats.cc), null included. A
// loss that is read computes what the one that was written did, since everything else it holds
// follows from these parameters. The names stay as they are, for files have them.

namespace inceres::internal {
namespace {

// After a failure every read gives 0: 1 in its place lets the object be made, which the failed load
// then throws away.
double ReadPositive(GraphReader* reader) {
  const double value = reader->ReadDouble();
  if (!(value > 0.0 && std::isfinite(value))) {
    reader->Fail("a scale is " + std::to_string(value) + " but must be positive");
  }
  return reader->ok() ? value : 1.0;
}

// A weight of 0 switches a factor off.
double ReadWeight(GraphReader* reader) {
  const double value = reader->ReadDouble();
  if (!(value >= 0.0 && std::isfinite(value))) {
    reader->Fail("a weight is " + std::to_string(value) + " but must not be negative");
  }
  return reader->ok() ? value : 1.0;
}

// A loss that is its scale a.
// Huber, soft-L1, Cauchy, arctan and Tukey are made with one number each.
template <typename L>
void AddScaled(const char* name, GraphFormats* formats) {
  formats->AddLoss<L>(
      std::string("inceres.") + name,
      [](const L& loss, GraphWriter* writer) { writer->WriteDouble(loss.a()); },
      [](GraphReader* reader) { return std::make_shared<L>(ReadPositive(reader)); });
}

}  // namespace

void AddBuiltInLosses(GraphFormats* formats) {
  AddScaled<HuberLoss>("huber_loss", formats);
  AddScaled<SoftLOneLoss>("soft_l_one_loss", formats);
  AddScaled<CauchyLoss>("cauchy_loss", formats);
  AddScaled<ArctanLoss>("arctan_loss", formats);
  AddScaled<TukeyLoss>("tukey_loss", formats);
  formats->AddLoss<TolerantLoss>(
      "inceres.tolerant_loss",
      [](const TolerantLoss& loss, GraphWriter* writer) {
        writer->WriteDouble(loss.a());
        writer->WriteDouble(loss.b());
      },
      [](GraphReader* reader) {
        // By itself and not as an argument: the order in which arguments are evaluated is the
        // compiler's.
        const double a = ReadPositive(reader);
        return std::make_shared<TolerantLoss>(a, ReadPositive(reader));
      });
  // A null inner loss is the identity, and so has a meaning: a weight on the squared norm.
  formats->AddLoss<ScaledLoss>(
      "inceres.scaled_loss",
      [](const ScaledLoss& loss, GraphWriter* writer) {
        writer->WriteLoss(loss.loss());
        writer->WriteDouble(loss.scale());
      },
      [](GraphReader* reader) {
        const std::shared_ptr<const Loss> loss = reader->ReadLoss();
        return std::make_shared<ScaledLoss>(loss, ReadWeight(reader));
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
