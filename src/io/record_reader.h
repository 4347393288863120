#pragma once

#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include "inceres/problem/rotation.h"
#include "inceres/status.h"
#include "io/byte_stream.h"
#include "io/text_scanner.h"

namespace inceres::internal {

/// What readers of records have in common: lines, the fields of the record at hand, and messages
/// `file:line: TAG: field: what is wrong`. Functions that return false have set status_; whoever is
/// told so returns false too, up to the reader's Read.
class RecordReader {
 public:
  RecordReader(const std::string& path, std::unique_ptr<ByteSource> source)
      : scanner_(path, std::move(source)) {}

 protected:
  /// Of records that begin with a tag, one a line: for each line that is not empty and no comment
  /// (#) sets tag_ to its first word, as it is shown (which changes no tag that a format knows),
  /// and calls read_fields(), which reads the rest; anything behind that is an error. Stops at the
  /// first failure.
  template <typename ReadFields>
  bool ForEachTaggedLine(const ReadFields& read_fields) {
    while (!scanner_.AtEnd()) {
      std::string_view word;
      if (!scanner_.ScanWord(&word)) {
        status_ = scanner_.Failure("tag");
        return false;
      }
      if (word.front() == '#') {
        scanner_.SkipLine();
        continue;
      }
      tag_ = Shown(word);
      if (!ReadLine(read_fields)) {
        return false;
      }
    }
    return true;
  }

  /// Of records without a tag: for each line that is not empty. There are no comments.
  template <typename ReadFields>
  bool ForEachLine(const ReadFields& read_fields) {
    while (!scanner_.AtEnd()) {
      if (!ReadLine(read_fields)) {
        return false;
      }
    }
    return true;
  }

  /// An integer from 0 on that fits into an int.
  bool ReadIndex(const char* field, int* index) {
    std::int64_t value = 0;
    if (!scanner_.ScanInteger(&value)) {
      return Missing(field);
    }
    if (value < 0 || value > std::numeric_limits<int>::max()) {
      return Fail(field, std::to_string(value) + (value < 0 ? " is negative" : " is too large"));
    }
    *index = static_cast<int>(value);
    return true;
  }

  /// An integer from 0 on: ids need not be dense.
  bool ReadId(const char* field, std::int64_t* id) {
    if (!scanner_.ScanInteger(id)) {
      return Missing(field);
    }
    return *id >= 0 || Fail(field, std::to_string(*id) + " is negative");
  }

  /// `field` names a vector: its entries are called field(0), field(1), …, the only entry of a
  /// scalar just field.
  bool ReadNumbers(const std::string& field, int count, double* values) {
    for (int k = 0; k < count; ++k) {
      if (!scanner_.ScanDouble(values + k)) {
        return Missing(field + (count > 1 ? "(" + std::to_string(k) + ")" : ""));
      }
    }
    return true;
  }

  /// A field of so many numbers, as above.
  struct Field {
    std::string name;
    int count;
    double* values;
  };
  /// One after the other, up to the first that is wrong.
  bool ReadFields(std::initializer_list<Field> fields) {
    for (const Field& field : fields) {
      if (!ReadNumbers(field.name, field.count, field.values)) {
        return false;
      }
    }
    return true;
  }

  // Each is false.

  /// For a token that scanned well and is not acceptable.
  bool Fail(const std::string& field, const std::string& what) {
    return FailAt(scanner_.line(), Named(field) + ": " + what);
  }
  /// For one that did not scan.
  bool Missing(const std::string& field) {
    status_ = scanner_.Failure(Named(field));
    return false;
  }
  bool FailAt(std::int64_t line, const std::string& what) {
    status_ = scanner_.FailureAt(line, what);
    return false;
  }

  std::string Named(const std::string& field) const {
    return tag_.empty() ? field : tag_ + ": " + field;
  }

  TextScanner scanner_;
  std::string tag_;
  Status status_;

 private:
  // The rest of a line. From StayInLine to LeaveLine a missing field is an error of this line, and
  // does not take the next line's first number.
  template <typename ReadFields>
  bool ReadLine(const ReadFields& read_fields) {
    scanner_.StayInLine();
    if (!read_fields()) {
      return false;
    }
    if (!scanner_.AtEnd()) {
      return Missing("after the last field");
    }
    scanner_.LeaveLine();
    return true;
  }
};

/// False if R, row-major, is no rotation. MatrixToQuaternion takes any matrix and is exact for
/// rotations only; back as a matrix, the quaternion shows how far the nine numbers were from one.
/// 1e-4 leaves room for files of few digits.
inline bool QuaternionOf(const double R[9], double q[4]) {
  double nearest[9];
  MatrixToQuaternion(R, q);
  QuaternionToMatrix(q, nearest);
  bool rotation = true;
  for (int k = 0; k < 9; ++k) {
    // In this form a NaN is refused too.
    rotation = rotation && std::fabs(R[k] - nearest[k]) < 1e-4;
  }
  return rotation;
}

/// Reads a whole file, decoded as its name asks for, with Reader(path, source).Read(result). After
/// a failure *result may be half filled.
template <typename Reader, typename Result>
Status ReadInto(const std::string& path, Result* result, const ReadOptions& options = ReadOptions(),
                const ReadProgress& progress = nullptr) {
  std::unique_ptr<ByteSource> source;
  Status status = OpenByteSource(path, &source, progress, options);
  return status.ok() ? Reader(path, std::move(source)).Read(result) : status;
}

/// The same, all or nothing: after a failure *result is as it was.
template <typename Reader, typename Result>
Status ReadFile(const std::string& path, Result* result, const ReadOptions& options,
                const ReadProgress& progress = nullptr) {
  Result read;
  Status status = ReadInto<Reader>(path, &read, options, progress);
  if (status.ok()) {
    *result = std::move(read);
  }
  return status;
}

}  // namespace inceres::internal
