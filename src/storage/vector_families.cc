#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "inceres/factors/diagonal_prior.h"
#include "inceres/factors/imu_factor.h"
#include "inceres/solver/marginalization.h"
#include "storage/built_in.h"

// The formats of families whose measurements differ in size from family to family or from factor to
// factor: diagonal priors, linear priors of marginalization, preintegrated IMU samples. A family's
// shape stands first, then its measurements, which have no sizes of their own.
//
// What is written is what a measurement was made of, and not all it holds: an IMU measurement is
// integrated anew from its samples when it is read, which gives the same bits as the integration
// that it stands for, and cannot give a covariance that contradicts the samples.
//
// A shape is a few numbers that may ask for much memory. Each is bounded, products are kept below
// overflow, and the number of measurements is held against the bytes that such measurements would
// take.

namespace inceres::internal {
namespace {

constexpr std::int32_t kMaxSize = 1 << 24;  // of a slot or a residual
// Bytes, of a family that has no prior in the file to be as large as.
constexpr std::size_t kEmptyShape = 1 << 20;

void WriteDiagonal(const DiagonalPriorFamily& family, GraphWriter* writer) {
  const auto size = static_cast<std::size_t>(family.residual_size());
  writer->WriteInt(family.residual_size());
  writer->WriteInt(family.slot(0).ambient_size);
  writer->WriteInt(family.slot(0).tangent_size);
  writer->WriteLong(family.size());
  for (int i = 0; i < family.size(); ++i) {
    writer->WriteDoubles(family.mean(i), size);
    writer->WriteDoubles(family.sqrt_information(i), size);
  }
}

std::shared_ptr<DiagonalPriorFamily> ReadDiagonal(GraphReader* reader) {
  const int size = reader->ReadIntIn(1, kMaxSize, "the size of a prior");
  // A prior is on the leading coordinates: its variable has at least as many.
  const int ambient = reader->ReadIntIn(size, kMaxSize, "the size of a variable");
  const int tangent = reader->ReadIntIn(0, ambient, "a tangent size");
  auto family = std::make_shared<DiagonalPriorFamily>(size, ambient, tangent);
  // A mean and a square root of the information for each row.
  const std::size_t count = reader->ReadCount(16 * static_cast<std::size_t>(size));
  for (std::size_t i = 0; i < count && reader->ok(); ++i) {
    DiagonalPriorFamily::Measurement measurement;
    measurement.mean = reader->ReadVector(static_cast<std::size_t>(size));
    measurement.sqrt_information = reader->ReadVector(static_cast<std::size_t>(size));
    // Vectors of a failed read are empty, and Add wants them of the family's size.
    if (reader->ok()) {
      family->Add(measurement);
    }
  }
  return family;
}

// e0, J row by row, then each block; all sizes are the family's.
void WritePrior(const LinearPrior& prior, GraphWriter* writer) {
  writer->WriteDoubles(prior.e0.data(), prior.e0.size());
  writer->WriteDoubles(prior.J.data(), prior.J.size());
  for (const LinearPrior::Block& block : prior.blocks) {
    writer->WriteDoubles(block.x0.data(), block.x0.size());
    writer->WriteManifold(block.manifold.get());
  }
}

// The shape of all its priors, then their numbers. Which manifold a block has may differ from prior
// to prior, so each prior has its own.
void WriteLinear(const LinearPriorFamily& family, GraphWriter* writer) {
  writer->WriteInt(family.residual_size());
  writer->WriteLong(family.num_slots());
  for (int s = 0; s < family.num_slots(); ++s) {
    writer->WriteInt(family.slot(s).ambient_size);
    writer->WriteInt(family.slot(s).tangent_size);
  }
  writer->WriteLong(family.size());
  for (int i = 0; i < family.size(); ++i) {
    WritePrior(family.prior(i), writer);
  }
}

// A prior of the shape of the family's, with x0, J and e0 to be read.
bool ReadPrior(const FactorFamily& family, std::size_t num_columns, GraphReader* reader,
               LinearPrior* prior) {
  const auto num_rows = static_cast<std::size_t>(family.residual_size());
  prior->e0 = reader->ReadVector(num_rows);
  prior->J = reader->ReadVector(num_rows * num_columns);
  prior->blocks.clear();
  for (int s = 0; s < family.num_slots() && reader->ok(); ++s) {
    LinearPrior::Block block;
    block.x0 = reader->ReadVector(static_cast<std::size_t>(family.slot(s).ambient_size));
    block.tangent_size = family.slot(s).tangent_size;
    block.manifold = reader->ReadManifold();
    const Manifold* manifold = block.manifold.get();
    // A null manifold is the Euclidean space of the slot's size. A manifold is read from the file
    // by itself, so its sizes may be others than the slot's, by which x ⊟ x0 would read and write
    // beyond its vectors.
    const bool fits = manifold == nullptr
                          ? block.tangent_size == family.slot(s).ambient_size
                          : manifold->TangentSize() == block.tangent_size &&
                                manifold->AmbientSize() == family.slot(s).ambient_size;
    if (!fits) {
      reader->Fail("a prior on a variable of another size than its manifold");
    }
    prior->blocks.push_back(std::move(block));
  }
  return reader->ok();
}

// The family is made of a prior of its shape, so one is put together of zeros before the first is
// read.
std::shared_ptr<LinearPriorFamily> ReadLinear(GraphReader* reader) {
  const int num_rows = reader->ReadIntIn(1, kMaxSize, "the number of rows");
  // Two sizes each.
  const std::size_t num_slots = reader->ReadCount(8);
  LinearPrior shape;
  std::size_t num_columns = 0;
  std::size_t num_values = 0;
  std::vector<FactorFamily::Slot> slots;
  for (std::size_t s = 0; s < num_slots && reader->ok(); ++s) {
    const int ambient = reader->ReadIntIn(1, kMaxSize, "the size of a variable");
    slots.push_back({ambient, reader->ReadIntIn(0, ambient, "a tangent size")});
    num_columns += static_cast<std::size_t>(slots.back().tangent_size);
    num_values += static_cast<std::size_t>(ambient);
  }
  const std::size_t rows = static_cast<std::size_t>(num_rows);
  // No product overflows: each factor is below 2^40.
  const bool small = num_columns < (std::size_t{1} << 38) / rows && num_values < (1U << 31);
  if (!small) {
    reader->Fail("a prior of too many rows and columns");
  }
  // Bytes of one prior: J, e0 and the x0 of all blocks. After a failure 1, for the products may
  // then overflow.
  const std::size_t count =
      reader->ReadCount(reader->ok() ? 8 * (rows * num_columns + rows + num_values) : 1);
  // With a prior in the file, the file is as large as the shape. Without one a few bytes could ask
  // for any, so the shape has to be small.
  if (!reader->ok() || (count == 0 && 8 * (rows + num_values) > kEmptyShape)) {
    reader->Fail("a family of priors without a prior, and too large");
    return nullptr;
  }
  shape.e0.resize(rows);
  for (const FactorFamily::Slot& slot : slots) {
    LinearPrior::Block block;
    block.x0.resize(static_cast<std::size_t>(slot.ambient_size));
    block.tangent_size = slot.tangent_size;
    shape.blocks.push_back(std::move(block));
  }
  auto family = std::make_shared<LinearPriorFamily>(shape);
  LinearPrior prior;
  for (std::size_t i = 0; i < count && ReadPrior(*family, num_columns, reader, &prior); ++i) {
    family->Add(prior);
  }
  return family;
}

// Every number and enumerator that an ImuPreintegrator is made with.
// One list for writing and for reading, so that the two cannot differ. An enumerator comes with the
// last one of its kind, up to which a byte is valid. Options is const for writing.
template <typename Options, typename Number, typename Enumerator>
void VisitImuOptions(Options& options, Number&& number, Enumerator&& enumerator) {
  number(options.noise.gyr);
  number(options.noise.acc);
  number(options.noise.gyr_bias_walk);
  number(options.noise.acc_bias_walk);
  number(options.max_rotation_change);
  number(options.max_speed_change);
  auto& conventions = options.conventions;
  for (auto& entry : conventions.gravity) {
    number(entry);
  }
  enumerator(conventions.perturbation, Perturbation::kLeft);
  enumerator(conventions.rotation_residual, ImuConventions::RotationResidual::kTwiceVector);
  enumerator(conventions.sign, ImuConventions::Sign::kMeasuredMinusState);
  // That each part is named once is checked by ImuOptions::Validate, when samples are integrated.
  for (auto& part : conventions.residual_order) {
    enumerator(part, ImuPart::kAccBias);
  }
  enumerator(conventions.bias_order, ImuConventions::BiasOrder::kAccFirst);
  enumerator(conventions.integration, ImuConventions::Integration::kEuler);
  enumerator(conventions.noise, ImuConventions::Noise::kPerSample);
}

void WriteImu(const ImuFactorFamily& family, GraphWriter* writer) {
  writer->WriteLong(family.size());
  for (int i = 0; i < family.size(); ++i) {
    const ImuPreintegrator& imu = family.measurement(i);
    VisitImuOptions(
        imu.options(), [writer](double value) { writer->WriteDouble(value); },
        [writer](auto value, auto) { writer->WriteByte(static_cast<std::uint8_t>(value)); });
    writer->WriteByte(imu.options().conventions.bias_walks_while_integrating ? 1 : 0);
    // The biases that the samples were integrated at last: a family may have integrated them anew
    // since they were added (max_rotation_change).
    writer->WriteDoubles(imu.delta().gyr_bias, 3);
    writer->WriteDoubles(imu.delta().acc_bias, 3);
    writer->WriteLong(static_cast<std::int64_t>(imu.samples().size()));
    for (const ImuSample& sample : imu.samples()) {
      writer->WriteDouble(sample.time);
      writer->WriteDoubles(sample.gyr, 3);
      writer->WriteDoubles(sample.acc, 3);
    }
  }
}

ImuOptions ReadImuOptions(GraphReader* reader) {
  ImuOptions options;
  VisitImuOptions(
      options, [reader](double& value) { value = reader->ReadDouble(); },
      [reader](auto& value, auto last) {
        const std::uint8_t read = reader->ReadByte();
        // Casting any byte would give enumerators that no switch knows.
        if (read > static_cast<std::uint8_t>(last)) {
          reader->Fail("a convention that does not exist");
        } else {
          value = static_cast<std::decay_t<decltype(value)>>(read);
        }
      });
  options.conventions.bias_walks_while_integrating = reader->ReadByte() != 0;
  return options;
}

std::shared_ptr<ImuFactorFamily> ReadImu(GraphReader* reader) {
  auto family = std::make_shared<ImuFactorFamily>();
  // Less than any measurement takes: only a bound for memory.
  const std::size_t count = reader->ReadCount(128);
  for (std::size_t i = 0; i < count && reader->ok(); ++i) {
    ImuPreintegrator imu(ReadImuOptions(reader));
    double gyr_bias[3] = {}, acc_bias[3] = {};
    reader->ReadDoubles(gyr_bias, 3);
    reader->ReadDoubles(acc_bias, 3);
    // Seven doubles.
    std::vector<ImuSample> samples(reader->ReadCount(56));
    for (ImuSample& sample : samples) {
      sample.time = reader->ReadDouble();
      reader->ReadDoubles(sample.gyr, 3);
      reader->ReadDoubles(sample.acc, 3);
    }
    // One that was never integrated has no samples, and is written as it is. Integrate checks the
    // samples, and the options by Validate.
    if (reader->ok() && !samples.empty()) {
      const Status status = imu.Integrate(samples, gyr_bias, acc_bias);
      if (!status.ok()) {
        reader->Fail("IMU samples that cannot be integrated: " + status.message);
      }
    }
    if (reader->ok()) {
      family->Add(imu);
    }
  }
  return family;
}

}  // namespace

void AddVectorFamilies(GraphFormats* formats) {
  formats->AddFamily<DiagonalPriorFamily>("inceres.diagonal_prior", WriteDiagonal, ReadDiagonal);
  formats->AddFamily<LinearPriorFamily>("inceres.linear_prior", WriteLinear, ReadLinear);
  formats->AddFamily<ImuFactorFamily>("inceres.imu_preintegration", WriteImu, ReadImu);
}

}  // namespace inceres::internal
