#pragma once

#include <cstddef>
#include <cstdint>

#include "inceres/storage/graph_stream.h"

namespace inceres::internal {

/// Writes all measurements of a built-in family that are doubles only (measurement_members.h),
/// place by place.
template <typename Family>
void WriteMeasurements(const Family& family, GraphWriter* writer) {
  writer->WriteLong(family.size());
  for (int i = 0; i < family.size(); ++i) {
    typename Family::Measurement measurement = family.measurement(i);
    VisitMeasurement(measurement, [writer](double* values, std::size_t count) {
      writer->WriteDoubles(values, count);
    });
  }
}

/// Adds what WriteMeasurements has written.
template <typename Family>
void ReadMeasurements(Family* family, GraphReader* reader) {
  typename Family::Measurement measurement;
  std::size_t num_doubles = 0;
  VisitMeasurement(measurement,
                   [&num_doubles](double*, std::size_t count) { num_doubles += count; });
  const std::size_t size = reader->ReadCount(8 * num_doubles);
  if (size > static_cast<std::size_t>(INT32_MAX)) {
    reader->Fail("more measurements than a family can hold");
  }
  for (std::size_t i = 0; i < size && reader->ok(); ++i) {
    VisitMeasurement(measurement, [reader](double* values, std::size_t count) {
      reader->ReadDoubles(values, count);
    });
    family->Add(measurement);
  }
}

}  // namespace inceres::internal
