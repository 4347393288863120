#include "inceres/storage/graph_formats.h"

#include "storage/built_in.h"

// How an object of any type stands in a file: the name of its format, a length, and as many bytes,
// which are the format's own. The length makes objects opaque to each other: a format that reads
// too much or too little is caught at the end of its own bytes, and named, rather than shifting
// everything behind it.
//
// Formats are looked up by dynamic type for writing, by name for reading, so a file can only ever
// make objects of types that the program has registered.

namespace inceres {
namespace {

// Of objects within objects, such as a scaled loss of a composed one: what is deeper is refused,
// for reading takes a part of the stack for each.
constexpr int kMaxDepth = 16;

}  // namespace

// A program may replace a built-in format by one of the same name, or add one of another name, by
// which the type is then written.
GraphFormats::GraphFormats() {
  internal::AddBuiltInManifolds(this);
  internal::AddBuiltInLosses(this);
  internal::AddBuiltInFamilies(this);
}

// Into a writer of its own first, since the length stands before the bytes. Bytes are copied once
// for each level of nesting.
template <typename Base>
void GraphFormats::WriteBy(const internal::FormatTable<Base>& table, const Base& object,
                           const std::string& what, GraphWriter* writer) {
  const auto* format = table.Of(object);
  // The type's name is the compiler's, mangled: still enough to find it by.
  if (format == nullptr) {
    writer->Fail(what + " is of a type without a format (" + typeid(object).name() +
                 "): add one to GraphFormats");
    return;
  }
  if (writer->depth_ >= kMaxDepth) {
    writer->Fail(what + " holds objects within objects too deeply");
    return;
  }
  GraphWriter inner(writer->formats_, writer->depth_ + 1);
  format->write(object, &inner);
  // Writing goes on all the same: a writer that has failed is never used.
  if (!inner.status().ok()) {
    writer->Fail(what + ": " + inner.status().message);
  }
  writer->WriteString(format->name);
  writer->WriteString(inner.bytes());
}

// Null, with the reader failed, unless all went well. Failures carry the path to the culprit:
// "family 3 (inceres.linear_prior): a manifold (…): …".
template <typename Base>
std::shared_ptr<Base> GraphFormats::ReadBy(const internal::FormatTable<Base>& table,
                                           const std::string& what, GraphReader* reader) {
  const std::string name = reader->ReadString();
  const std::size_t size = reader->ReadCount(1);
  // Taken from the outer reader whether or not the format is known: nothing is copied, the inner
  // reader looks into the same bytes.
  const char* bytes = reader->Take(size);
  if (bytes == nullptr) {
    return nullptr;
  }
  const auto* format = table.Named(name);
  if (format == nullptr) {
    reader->Fail(what + " has the format '" + name + "', which is not known here");
    // A file that is fine, for a program that knows more: another code than that of a damaged one.
    reader->status_.code = StatusCode::kUnavailable;
    return nullptr;
  }
  if (reader->depth_ >= kMaxDepth) {
    reader->Fail(what + " holds objects within objects too deeply");
    return nullptr;
  }
  GraphReader inner(bytes, size, reader->formats_, reader->depth_ + 1);
  std::shared_ptr<Base> object = format->read(&inner);
  // A format that has left bytes unread is not the one that wrote them.
  if (inner.ok() && inner.remaining() > 0) {
    inner.Fail(std::to_string(inner.remaining()) + " bytes are left over");
  }
  if (inner.ok() && object == nullptr) {
    inner.Fail("nothing was read");
  }
  if (!inner.ok()) {
    reader->Fail(what + " (" + name + "): " + inner.status().message);
    reader->status_.code = inner.status().code;
    return nullptr;
  }
  return object;
}

void GraphFormats::Write(const FactorFamily& family, const std::string& what,
                         GraphWriter* writer) const {
  WriteBy(families_, family, what, writer);
}
void GraphFormats::Write(const Manifold& manifold, const std::string& what,
                         GraphWriter* writer) const {
  WriteBy(manifolds_, manifold, what, writer);
}
void GraphFormats::Write(const Loss& loss, const std::string& what, GraphWriter* writer) const {
  WriteBy(losses_, loss, what, writer);
}
std::shared_ptr<FactorFamily> GraphFormats::ReadFamily(const std::string& what,
                                                       GraphReader* reader) const {
  return ReadBy(families_, what, reader);
}
std::shared_ptr<Manifold> GraphFormats::ReadManifold(const std::string& what,
                                                     GraphReader* reader) const {
  return ReadBy(manifolds_, what, reader);
}
std::shared_ptr<Loss> GraphFormats::ReadLoss(const std::string& what, GraphReader* reader) const {
  return ReadBy(losses_, what, reader);
}

}  // namespace inceres
