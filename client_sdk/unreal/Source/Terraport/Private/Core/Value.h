// A tree of plain values, and its two readers: msgpack for messages, JSON for a scene's files.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "Core/Basics.h"

namespace terraport {

/// One value of msgpack or JSON.
struct Value {
  enum class Kind : std::uint8_t { Absent, Nil, Boolean, Integer, Number, Text, Binary, List, Map };

  Kind kind = Kind::Absent;
  bool boolean = false;
  /// Integers beyond int64 are read as `Number`.
  std::int64_t integer = 0;
  double number = 0.0;
  /// UTF-8 text, or the bytes of a binary.
  std::string text;
  std::vector<Value> items;
  /// Each key once.
  std::vector<std::pair<std::string, Value>> members;

  bool isAbsent() const { return kind == Kind::Absent || kind == Kind::Nil; }
  bool isMap() const { return kind == Kind::Map; }
  bool isList() const { return kind == Kind::List; }
  bool isBinary() const { return kind == Kind::Binary; }
  ByteSpan bytes() const { return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}; }

  /// The member of a map; an absent value where there is none.
  const Value& operator[](std::string_view key) const;

  /// The value in that form and range; nothing otherwise. An integer is a number, too.
  std::optional<std::int64_t> integerIn(std::int64_t low, std::int64_t high) const;
  std::optional<double> numberIn(double low, double high) const;
  std::optional<std::string> textUpTo(std::size_t mostCodePoints) const;
  std::optional<bool> flag() const;
  /// Three numbers, each of at most this size.
  std::optional<Vec3> point(double mostM = std::numeric_limits<double>::max()) const;
};

constexpr std::int64_t kMaxU32 = 0xFFFFFFFF;

/// Read one msgpack value that takes all of the bytes: at most 16 levels deep, at most 16,384 items in a
/// map or list, keys are text and each stands once.
Status readMsgpack(ByteSpan bytes, Value& out);

/// Read one JSON document (RFC 8259).
Status readJson(ByteSpan bytes, Value& out);

bool isUtf8(std::string_view text);

/// Appends msgpack.
class MsgpackWriter {
 public:
  explicit MsgpackWriter(Bytes& out) : out_(out) {}
  void map(std::size_t members) { head(0x80, 16, 0xde, members); }
  void list(std::size_t items) { head(0x90, 16, 0xdc, items); }
  void text(std::string_view text);
  void binary(ByteSpan bytes);
  void integer(std::uint64_t number);
  void number(double number);

 private:
  void head(unsigned fixed, std::size_t fixedCount, unsigned token16, std::size_t count);
  void bigEndian(std::uint64_t number, int bytes);

  Bytes& out_;
};

}  // namespace terraport
