#pragma once

#include <cstdint>
#include <initializer_list>
#include <limits>
#include <memory>
#include <string>
#include <utility>

#include "inceres/status.h"
#include "io/byte_source.h"
#include "io/text_scanner.h"

namespace inceres::internal {

/// What readers of tagged records (ForEachTaggedLine) have in common: the fields of the record at
/// hand, and messages `file:line: TAG: field: what is wrong`.
class RecordReader {
 protected:
  RecordReader(const std::string& path, std::unique_ptr<ByteSource> source)
      : scanner_(path, std::move(source)) {}

  /// An integer from 0 on that fits into an int.
  Status ReadIndex(const char* field, int* index) {
    std::int64_t value = 0;
    if (!scanner_.ScanInteger(&value)) {
      return scanner_.Failure(tag_ + ": " + field);
    }
    if (value < 0 || value > std::numeric_limits<int>::max()) {
      return Fail(field, std::to_string(value) + (value < 0 ? " is negative" : " is too large"));
    }
    *index = static_cast<int>(value);
    return Status::Ok();
  }

  /// `field` names a vector: its entries are called field(0), field(1), …, the only entry of a
  /// scalar just field.
  Status ReadNumbers(const std::string& field, int count, double* values) {
    for (int k = 0; k < count; ++k) {
      if (!scanner_.ScanDouble(values + k)) {
        return scanner_.Failure(tag_ + ": " + field +
                                (count > 1 ? "(" + std::to_string(k) + ")" : ""));
      }
    }
    return Status::Ok();
  }

  /// A field of so many numbers, as above.
  struct Field {
    std::string name;
    int count;
    double* values;
  };
  /// One after the other, up to the first that is wrong.
  Status ReadFields(std::initializer_list<Field> fields) {
    for (const Field& field : fields) {
      if (Status status = ReadNumbers(field.name, field.count, field.values); !status.ok()) {
        return status;
      }
    }
    return Status::Ok();
  }

  Status Fail(const std::string& field, const std::string& what) const {
    return scanner_.FailureAt(scanner_.line(), tag_ + ": " + field + ": " + what);
  }

  TextScanner scanner_;
  std::string tag_;
};

}  // namespace inceres::internal
