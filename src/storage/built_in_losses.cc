#include <cmath>
#include <memory>
#include <string>

#include "inceres/problem/losses.h"
#include "storage/built_in.h"

namespace inceres::internal {
namespace {

double ReadPositive(GraphReader* reader) {
  const double value = reader->ReadDouble();
  if (!(value > 0.0 && std::isfinite(value))) {
    reader->Fail("a scale is " + std::to_string(value) + " but must be positive");
  }
  return reader->ok() ? value : 1.0;
}

// A loss that is its scale a.
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
        const double a = ReadPositive(reader);
        return std::make_shared<TolerantLoss>(a, ReadPositive(reader));
      });
  formats->AddLoss<ScaledLoss>(
      "inceres.scaled_loss",
      [](const ScaledLoss& loss, GraphWriter* writer) {
        writer->WriteLoss(loss.loss());
        writer->WriteDouble(loss.scale());
      },
      [](GraphReader* reader) {
        const std::shared_ptr<const Loss> loss = reader->ReadLoss();
        return std::make_shared<ScaledLoss>(loss, reader->ReadDouble());
      });
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
