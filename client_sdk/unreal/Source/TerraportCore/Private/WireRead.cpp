#include "WireRead.h"

#include "Bytes.h"

#include <cmath>

namespace terraport {

namespace {

constexpr std::size_t kIdRowBytes = 4;
constexpr std::size_t kHeldRowBytes = 12;
constexpr std::size_t kLoadRowBytes = 48;
constexpr std::uint64_t kMaxU32 = 0xFFFFFFFF;

std::string show(const JsonValue& value) {
  switch (value.kind()) {
    case JsonKind::Null:
      return "nothing";
    case JsonKind::Boolean:
      return *value.boolean() ? "true" : "false";
    case JsonKind::Integer:
      return value.integer() ? std::to_string(*value.integer()) : "an integer beyond 2^53";
    case JsonKind::Float:
      return value.number() ? std::to_string(*value.number()) : "no finite number";
    case JsonKind::Text:
      return shortened(*value.text());
    case JsonKind::Binary:
      return std::to_string(value.binary()->size) + " bytes of binary";
    case JsonKind::List:
      return "a list of " + std::to_string(value.size());
    case JsonKind::Map:
      return "a map of " + std::to_string(value.size());
  }
  return "a value";
}

bool wrong(const JsonValue& raw, const std::string& expected, Refusal& refusal) {
  return refuse(refusal, "got " + show(raw) + ", expected " + expected);
}

/// Rows of a binary; false with a refusal where there are none such.
bool rowsOf(const JsonValue& raw, std::size_t rowBytes, const RowsKind& kind, ByteSpan& rows, Refusal& refusal) {
  const std::optional<ByteSpan> binary = raw.binary();
  if (!binary || binary->size % rowBytes != 0) {
    return wrong(raw, "binary of a multiple of " + std::to_string(rowBytes) + " bytes", refusal);
  }
  if (binary->size / rowBytes > kind.most) return wrong(raw, "at most " + std::to_string(kind.most) + " rows", refusal);
  rows = *binary;
  return true;
}

bool readRowU32(const JsonValue& raw, std::uint32_t& into, Refusal& refusal) {
  return readValue(raw, into, IntegerKind{0, kMaxU32}, refusal);
}

void unpack(const std::uint8_t* row, std::uint32_t& into) {
  into = readU32Le(row);
}

void unpack(const std::uint8_t* row, HeldRow& into) {
  into.segment = readU32Le(row);
  into.xxh3 = readU64Le(row + 4);
}

void unpack(const std::uint8_t* row, SegmentFacts& into) {
  into.segment = readU32Le(row);
  into.length = readU32Le(row + 4);
  into.xxh3 = readU64Le(row + 8);
  into.faces = readU32Le(row + 16);
  into.vertices = readU32Le(row + 20);
  into.bounds = {readF32Le(row + 24), readF32Le(row + 28), readF32Le(row + 32), readF32Le(row + 36), readF32Le(row + 40),
      readF32Le(row + 44)};
}

template <typename Row>
bool readRows(const JsonValue& raw, std::size_t rowBytes, std::vector<Row>& into, const RowsKind& kind, Refusal& refusal) {
  into.clear();
  ByteSpan rows;
  if (!rowsOf(raw, rowBytes, kind, rows, refusal)) return false;
  into.resize(rows.size / rowBytes);
  for (std::size_t number = 0; number < into.size(); ++number) unpack(rows.data + number * rowBytes, into[number]);
  return true;
}

}  // namespace

bool readLayout(const JsonValue& raw, std::vector<std::uint32_t>& into, const RowsKind& kind, Refusal& refusal) {
  return readRows(raw, kIdRowBytes, into, kind, refusal);
}

bool readLayout(const JsonValue& raw, std::vector<HeldRow>& into, const RowsKind& kind, Refusal& refusal) {
  return readRows(raw, kHeldRowBytes, into, kind, refusal);
}

bool readLayout(const JsonValue& raw, std::vector<SegmentFacts>& into, const RowsKind& kind, Refusal& refusal) {
  return readRows(raw, kLoadRowBytes, into, kind, refusal);
}

bool readLayout(const JsonValue& raw, std::vector<NamedNumber>&, const NumbersKind&, Refusal& refusal) {
  return raw.isMap() || wrong(raw, "a map of numbers", refusal);
}

bool readValue(const JsonValue& raw, std::uint64_t& into, const IntegerKind& kind, Refusal& refusal) {
  const std::optional<std::int64_t> whole = raw.integer();
  if (whole && *whole >= 0) {
    into = static_cast<std::uint64_t>(*whole);
    return checkValue(into, kind, refusal);
  }
  return wrong(raw, "an integer from " + std::to_string(kind.low) + " to " + std::to_string(kind.high), refusal);
}

bool readValue(const JsonValue& raw, std::uint32_t& into, const IntegerKind& kind, Refusal& refusal) {
  std::uint64_t whole = 0;
  if (!readValue(raw, whole, kind, refusal)) return false;
  into = static_cast<std::uint32_t>(whole);
  return true;
}

bool readValue(const JsonValue& raw, double& into, const NumberKind& kind, Refusal& refusal) {
  const std::optional<double> number = raw.number();
  if (!number) return wrong(raw, "a finite number", refusal);
  into = *number;
  return checkValue(into, kind, refusal);
}

bool readValue(const JsonValue& raw, bool& into, const FlagKind&, Refusal& refusal) {
  const std::optional<bool> flag = raw.boolean();
  if (!flag) return wrong(raw, "true or false", refusal);
  into = *flag;
  return true;
}

bool readValue(const JsonValue& raw, std::string& into, const TextKind& kind, Refusal& refusal) {
  const std::optional<std::string_view> text = raw.text();
  if (!text) return wrong(raw, "text", refusal);
  into.assign(*text);
  return checkValue(into, kind, refusal);
}

bool readValue(const JsonValue& raw, std::string& into, const ChoiceKind& kind, Refusal& refusal) {
  const std::optional<std::string_view> text = raw.text();
  if (!text) return wrong(raw, "text", refusal);
  into.assign(*text);
  return checkValue(into, kind, refusal);
}

bool readValue(const JsonValue& raw, Vec3& into, const PositionKind& kind, Refusal& refusal) {
  if (!raw.isList() || raw.size() != 3) return wrong(raw, "three numbers", refusal);
  auto item = raw.items().begin();
  for (double* const axis : {&into.x, &into.y, &into.z}) {
    const std::optional<double> number = (*item).number();
    if (!number) return wrong(*item, "three finite numbers", refusal);
    *axis = *number;
    ++item;
  }
  return checkValue(into, kind, refusal);
}

bool readValue(const JsonValue& raw, ProtocolVersion& into, const VersionKind& kind, Refusal& refusal) {
  if (!raw.isList() || raw.size() != 2) return wrong(raw, "a version [major, minor]", refusal);
  auto item = raw.items().begin();
  if (!readRowU32(*item, into.majorNumber, refusal)) return false;
  return readRowU32(*++item, into.minorNumber, refusal) && checkValue(into, kind, refusal);
}

bool readValue(const JsonValue& raw, std::vector<ProtocolVersion>& into, const VersionsKind& kind, Refusal& refusal) {
  into.clear();
  if (!raw.isList() || raw.size() > kind.most) {
    return wrong(raw, "a list of at most " + std::to_string(kind.most) + " versions", refusal);
  }
  for (const JsonValue item : raw.items()) {
    into.emplace_back();
    if (!readValue(item, into.back(), VersionKind{}, refusal)) return false;
  }
  return true;
}

bool readValue(const JsonValue& raw, std::vector<NamedNumber>& into, const NumbersKind& kind, Refusal& refusal) {
  into.clear();
  if (raw.size() > kind.most) return wrong(raw, "at most " + std::to_string(kind.most) + " numbers", refusal);
  const JsonValue::Range members = raw.items();
  for (auto member = members.begin(); member != members.end(); ++member) {
    const std::optional<double> number = (*member).number();
    into.push_back({std::string(member.key()), number.value_or(std::nan(""))});
  }
  return checkValue(into, kind, refusal);
}

}  // namespace terraport
