#pragma once

#include "Terraport/Api.h"
#include "Terraport/Status.h"
#include "Terraport/Types.h"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace terraport {

class JsonDocument;

/// What a value is.
enum class JsonKind : std::uint8_t {
  Null,
  Boolean,
  /// Written without fraction and exponent, of any size.
  Integer,
  Float,
  Text,
  /// Only in messages, which are msgpack.
  Binary,
  List,
  Map,
};

/// Bounds on what is read. A document beyond one of them is refused as `malformed`; nothing is reserved for what the bytes
/// at hand do not have.
struct JsonLimits {
  /// Bytes of the text.
  std::size_t maxBytes = 64u * 1024 * 1024;
  /// Lists and maps around a value.
  std::uint32_t maxDepth = 32;
  /// Values and keys; each takes 24 bytes of memory.
  std::uint32_t maxValues = 4u * 1024 * 1024;
};

/// One value of a `JsonDocument`: a handle, as cheap as a pointer, valid until the document is read anew or destroyed.
/// Every question may be asked of every value, the absent one included; a wrong one answers "nothing".
class TERRAPORTCORE_API JsonValue {
 public:
  class Iterator;
  class Range;

  /// The absent value.
  JsonValue() = default;

  /// Whether there is a value; null is one.
  bool exists() const { return document_ != nullptr; }
  /// `Null` where it is absent.
  JsonKind kind() const;
  /// Whether it is null or absent.
  bool isNothing() const { return kind() == JsonKind::Null; }
  bool isMap() const { return kind() == JsonKind::Map; }
  bool isList() const { return kind() == JsonKind::List; }

  std::optional<bool> boolean() const;
  /// An integer written as one, of size at most 2^53 - 1.
  std::optional<std::int64_t> integer() const;
  /// A finite number, integer or not, rounded correctly.
  std::optional<double> number() const;
  /// A text, UTF-8; a view that lives as long as the document and its text.
  std::optional<std::string_view> text() const;
  /// The bytes of a binary; a view as for `text`.
  std::optional<ByteSpan> binary() const;

  /// Items of a list, members of a map, else 0.
  std::uint32_t size() const;
  /// The member of a map with this key; absent where there is none. Looks at the keys one after the other.
  JsonValue member(std::string_view key) const;
  /// The items of a list, or the values of a map, in order.
  Range items() const;

 private:
  friend class JsonDocument;
  JsonValue(const JsonDocument* document, std::uint32_t index) : document_(document), index_(index) {}

  const JsonDocument* document_ = nullptr;
  std::uint32_t index_ = 0;
};

/// A walk over items or members.
class TERRAPORTCORE_API JsonValue::Iterator {
 public:
  JsonValue operator*() const { return JsonValue(document_, isMap_ ? index_ + 1 : index_); }
  /// Key of the member; empty for an item of a list.
  std::string_view key() const;
  Iterator& operator++();
  bool operator!=(const Iterator& other) const { return left_ != other.left_; }

 private:
  friend class JsonValue;
  const JsonDocument* document_ = nullptr;
  std::uint32_t index_ = 0;
  std::uint32_t left_ = 0;
  bool isMap_ = false;
};

/// What `for` walks over.
class TERRAPORTCORE_API JsonValue::Range {
 public:
  Iterator begin() const { return begin_; }
  Iterator end() const { return Iterator(); }

 private:
  friend class JsonValue;
  Iterator begin_;
};

/// A strict reader of one JSON text (RFC 8259): repeated keys, `NaN`, comments, a byte order mark, bytes that are no UTF-8
/// and anything after the value are refused. The values lie in one array, so that reading again reuses its memory, and no
/// nesting can exhaust the stack.
class TERRAPORTCORE_API JsonDocument {
 public:
  /// Read `text`, which must outlive the document or its next use: texts without escapes are views of it.
  /// Error code: `malformed`, with the byte where.
  Status read(std::string_view text, const JsonLimits& limits = {});

  /// The value; absent before a successful `read`.
  JsonValue root() const { return nodes_.empty() ? JsonValue() : JsonValue(this, 0); }

 private:
  friend class JsonValue;
  friend class JsonValue::Iterator;
  friend class JsonReader;
  friend class MsgpackReader;

  enum Flag : std::uint8_t {
    /// The text lies in `decoded_`, not in the source.
    kDecoded = 1,
    /// The number is still text: `offset`, `length` of the source.
    kUnread = 2,
    kTrue = 4,
    /// An integer beyond 2^53 - 1: `real` holds it, rounded.
    kRounded = 8,
  };

  struct Node {
    /// Of a text, a binary or an unread number, in bytes.
    std::uint32_t offset = 0;
    /// As `offset`; of a list or map, its items or members.
    std::uint32_t length = 0;
    /// Index of the first value behind this one and all inside it.
    std::uint32_t after = 0;
    JsonKind kind = JsonKind::Null;
    std::uint8_t flags = 0;
    union {
      std::int64_t whole = 0;
      double real;
    };
  };

  void clear();
  std::string_view textOf(const Node& node) const;
  /// Whether a map has a key twice; sorts, so that a hostile one costs no more than n log n.
  bool hasKeyTwice(std::uint32_t map) const;

  std::vector<Node> nodes_;
  std::string decoded_;
  std::string_view source_;
  mutable std::vector<std::string_view> keys_;
};

/// Read a decimal number as JSON has it, rounded to the nearest double whatever the locale; infinite where it is too large.
TERRAPORTCORE_API double readDecimal(std::string_view text);

}  // namespace terraport
