// Fields of messages to msgpack.
#pragma once

#include "Bytes.h"
#include "Msgpack.h"
#include "WireChecks.h"

#include <optional>

namespace terraport {

/// Checks each field as the reader does.
struct CheckPass {
  Refusal& refusal;

  template <typename Value, typename Kind>
  bool field(const char* name, const Value& value, const Kind& kind) {
    return checkContent(value, kind) || refusedBelow(refusal, name);
  }

  template <typename Value, typename Kind>
  bool field(const char* name, const std::optional<Value>& value, const Kind& kind) {
    return !value.has_value() || checkContent(*value, kind) || refusedBelow(refusal, name);
  }

  template <typename Value, typename Kind>
  bool checkContent(const Value& value, const Kind& kind) {
    return checkValue(value, kind, refusal);
  }

  template <typename Part>
  bool checkContent(const Part& part, const PartKind&) {
    return FieldsOf<Part>::visit(*this, part);
  }

  template <typename Part>
  bool checkContent(const std::vector<Part>& parts, const PartsKind& kind) {
    if (parts.size() > kind.most) return refuse(refusal, "got too many maps");
    for (std::size_t number = 0; number < parts.size(); ++number) {
      if (!FieldsOf<Part>::visit(*this, parts[number])) return refusedBelow(refusal, std::to_string(number));
    }
    return true;
  }
};

/// Counts the fields that are there: msgpack says it first.
struct CountPass {
  std::size_t count = 0;

  template <typename Value, typename Kind>
  bool field(const char*, const Value&, const Kind&) {
    ++count;
    return true;
  }

  template <typename Value, typename Kind>
  bool field(const char*, const std::optional<Value>& value, const Kind&) {
    count += value.has_value() ? 1 : 0;
    return true;
  }
};

/// Writes each field that is there.
struct WritePass {
  MsgpackWriter& writer;
  /// The writer's own output: rows are appended to it directly.
  std::string& bytes;

  template <typename Value, typename Kind>
  bool field(const char* name, const Value& value, const Kind& kind) {
    writer.key(name);
    write(value, kind);
    return true;
  }

  template <typename Value, typename Kind>
  bool field(const char* name, const std::optional<Value>& value, const Kind& kind) {
    if (value.has_value()) field(name, *value, kind);
    return true;
  }

  /// All fields of a message (with its type) or a part, as one map.
  template <typename Part>
  void fieldsOf(const Part& part, bool hasType) {
    CountPass counted{hasType ? std::size_t{1} : std::size_t{0}};
    FieldsOf<Part>::visit(counted, part);
    writer.beginMap(counted.count);
    if (hasType) {
      writer.key("type");
      writer.text(FieldsOf<Part>::kType);
    }
    FieldsOf<Part>::visit(*this, part);
  }

 private:
  void write(std::uint64_t value, const IntegerKind&) { writer.integer(value); }
  void write(double value, const NumberKind&) { writer.real(value); }
  void write(bool value, const FlagKind&) { writer.flag(value); }
  void write(const std::string& value, const TextKind&) { writer.text(value); }
  void write(const std::string& value, const ChoiceKind&) { writer.text(value); }

  void write(const Vec3& value, const PositionKind&) {
    writer.beginList(3);
    for (const double axis : {value.x, value.y, value.z}) writer.real(axis);
  }

  void write(const ProtocolVersion& value, const VersionKind&) {
    writer.beginList(2);
    writer.integer(value.majorNumber);
    writer.integer(value.minorNumber);
  }

  void write(const std::vector<ProtocolVersion>& value, const VersionsKind&) {
    writer.beginList(value.size());
    for (const ProtocolVersion& version : value) write(version, VersionKind{});
  }

  void write(const std::vector<NamedNumber>& value, const NumbersKind&) {
    writer.beginMap(value.size());
    for (const NamedNumber& number : value) {
      writer.key(number.name);
      writer.real(number.value);
    }
  }

  template <typename Part>
  void write(const Part& part, const PartKind&) {
    fieldsOf(part, false);
  }

  template <typename Part>
  void write(const std::vector<Part>& parts, const PartsKind&) {
    writer.beginList(parts.size());
    for (const Part& part : parts) fieldsOf(part, false);
  }

  template <typename Row>
  void write(const std::vector<Row>& rows, const RowsKind&) {
    writer.beginBinary(rows.size() * rowBytes(static_cast<const Row*>(nullptr)));
    for (const Row& row : rows) pack(row);
  }

  static std::size_t rowBytes(const std::uint32_t*) { return 4; }
  static std::size_t rowBytes(const HeldRow*) { return 12; }
  static std::size_t rowBytes(const SegmentFacts*) { return 48; }

  void pack(std::uint32_t row) { appendLe(row, 4, bytes); }

  void pack(const HeldRow& row) {
    appendLe(row.segment, 4, bytes);
    appendLe(row.xxh3, 8, bytes);
  }

  void pack(const SegmentFacts& row) {
    appendLe(row.segment, 4, bytes);
    appendLe(row.length, 4, bytes);
    appendLe(row.xxh3, 8, bytes);
    appendLe(row.faces, 4, bytes);
    appendLe(row.vertices, 4, bytes);
    const Box& box = row.bounds;
    for (const float side : {box.minX, box.minY, box.minZ, box.maxX, box.maxY, box.maxZ}) appendF32Le(side, bytes);
  }
};

}  // namespace terraport
