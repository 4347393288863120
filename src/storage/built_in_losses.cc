#include <cmath>
#include <memory>
#include <string>

#include "inceres/problem/losses.h"
#include "storage/built_in.h"

// The formats of the built-in losses: the parameters that each was made with, and for losses of
// losses the inner ones by their own formats, with a name each (graph_formats.cc), null included. A
// loss that is read computes what the one that was written did, since everything else it holds
// follows from these parameters. The names stay as they are, for files have them.
//
// Losses take any parameters. Those that a reader refuses are not written in the first place.

namespace inceres::internal {
namespace {

bool IsScale(double value) {
  return value > 0.0 && std::isfinite(value);
}

// A weight of 0 switches a factor off.
bool IsWeight(double value) {
  return value >= 0.0 && std::isfinite(value);
}

std::string NoScale(double value) {
  return "a scale is " + std::to_string(value) + " but must be positive and finite";
}

std::string NoWeight(double value) {
  return "a weight is " + std::to_string(value) + " but must be finite and not negative";
}

void WriteScale(double value, GraphWriter* writer) {
  if (!IsScale(value)) {
    writer->Fail(NoScale(value));
  }
  writer->WriteDouble(value);
}

void WriteWeight(double value, GraphWriter* writer) {
  if (!IsWeight(value)) {
    writer->Fail(NoWeight(value));
  }
  writer->WriteDouble(value);
}

// After a failure every read gives 0: 1 in its place lets the object be made, which the failed load
// then throws away.
double ReadScale(GraphReader* reader) {
  const double value = reader->ReadDouble();
  if (!IsScale(value)) {
    reader->Fail(NoScale(value));
  }
  return reader->ok() ? value : 1.0;
}

double ReadWeight(GraphReader* reader) {
  const double value = reader->ReadDouble();
  if (!IsWeight(value)) {
    reader->Fail(NoWeight(value));
  }
  return reader->ok() ? value : 1.0;
}

// A loss that is its scale a.
// Huber, soft-L1, Cauchy, arctan and Tukey are made with one number each.
template <typename L>
void AddScaled(const char* name, GraphFormats* formats) {
  formats->AddLoss<L>(
      std::string("inceres.") + name,
      [](const L& loss, GraphWriter* writer) { WriteScale(loss.a(), writer); },
      [](GraphReader* reader) { return std::make_shared<L>(ReadScale(reader)); });
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
        WriteScale(loss.a(), writer);
        WriteScale(loss.b(), writer);
      },
      [](GraphReader* reader) {
        // By itself and not as an argument: the order in which arguments are evaluated is the
        // compiler's.
        const double a = ReadScale(reader);
        return std::make_shared<TolerantLoss>(a, ReadScale(reader));
      });
  // A null inner loss is the identity, and so has a meaning: a weight on the squared norm.
  formats->AddLoss<ScaledLoss>(
      "inceres.scaled_loss",
      [](const ScaledLoss& loss, GraphWriter* writer) {
        writer->WriteLoss(loss.loss());
        WriteWeight(loss.scale(), writer);
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
