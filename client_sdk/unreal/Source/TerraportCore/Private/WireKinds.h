// What a field of a message may be: the vocabulary of the generated fields. Reading, checking and writing by it is in
// WireRead.h, WireChecks.h and WireWrite.h.
#pragma once

#include "Terraport/Types.h"

#include <cstddef>
#include <cstdint>
#include <string>

namespace terraport {

/// A protocol version.
struct ProtocolVersion {
  std::uint32_t majorNumber = 0;
  std::uint32_t minorNumber = 0;
};

/// One held segment with its hash: a row of a held table.
struct HeldRow {
  std::uint32_t segment = 0;
  /// XXH3-64 of the payload.
  std::uint64_t xxh3 = 0;
};

/// One number of a map of numbers.
struct NamedNumber {
  std::string name;
  double value = 0;
};

/// A message of a type that this version does not know in that direction: skip it.
struct UnknownMessage {
  /// At most 64 characters of its type.
  std::string type;
};

struct IntegerKind {
  std::uint64_t low;
  std::uint64_t high;
};

struct NumberKind {
  double low;
  double high;
  bool lowExcluded;
};

struct FlagKind {};

enum class TextPattern : std::uint8_t {
  Any,
  /// `[A-Za-z0-9_.~-]+`
  GroupName,
  /// `[a-z][a-z0-9_]*`
  Word,
};

/// Lengths count code points.
struct TextKind {
  std::size_t shortest;
  std::size_t longest;
  TextPattern pattern;
};

struct ChoiceKind {
  static constexpr std::size_t kMost = 4;
  const char* options[kMost];
  std::size_t count;
};

template <typename... Option>
constexpr ChoiceKind choiceOf(Option... options) {
  static_assert(sizeof...(Option) <= ChoiceKind::kMost, "more options than ChoiceKind has room for");
  return ChoiceKind{{options...}, sizeof...(Option)};
}

struct PositionKind {
  double bound;
  bool nonzero;
};

struct VersionKind {};

struct VersionsKind {
  std::size_t most;
};

struct NumbersKind {
  std::size_t most;
};

/// Ids, held rows or load rows: one binary of little-endian rows.
struct RowsKind {
  std::size_t most;
};

struct PartKind {};

struct PartsKind {
  std::size_t most;
};

}  // namespace terraport
