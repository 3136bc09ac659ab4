// Fields of messages from values.
//
// A message is read in three passes, as the Python side does it, so that both name the same field of a message with several
// faults: layout of every field, value of every field, rules between fields.
#pragma once

#include "Terraport/Json.h"
#include "WireChecks.h"

#include <optional>

namespace terraport {

template <typename Message>
bool readFields(const JsonValue& raw, Message& into, Refusal& refusal);

// ---- first pass: what has an inner layout

template <typename Value, typename Kind>
bool readLayout(const JsonValue&, Value&, const Kind&, Refusal&) {
  return true;
}
bool readLayout(const JsonValue& raw, std::vector<std::uint32_t>& into, const RowsKind& kind, Refusal& refusal);
bool readLayout(const JsonValue& raw, std::vector<HeldRow>& into, const RowsKind& kind, Refusal& refusal);
bool readLayout(const JsonValue& raw, std::vector<SegmentFacts>& into, const RowsKind& kind, Refusal& refusal);
bool readLayout(const JsonValue& raw, std::vector<NamedNumber>& into, const NumbersKind& kind, Refusal& refusal);

template <typename Part>
bool readLayout(const JsonValue& raw, Part& into, const PartKind&, Refusal& refusal) {
  return readFields(raw, into, refusal);
}

template <typename Part>
bool readLayout(const JsonValue& raw, std::vector<Part>& into, const PartsKind& kind, Refusal& refusal) {
  into.clear();
  if (!raw.isList() || raw.size() > kind.most) {
    return refuse(refusal, "expected a list of at most " + std::to_string(kind.most));
  }
  into.reserve(raw.size());
  for (const JsonValue item : raw.items()) {
    into.emplace_back();
    if (!readFields(item, into.back(), refusal)) {
      return refusedBelow(refusal, std::to_string(into.size() - 1));
    }
  }
  return true;
}

// ---- second pass: values

bool readValue(const JsonValue& raw, std::uint32_t& into, const IntegerKind& kind, Refusal& refusal);
bool readValue(const JsonValue& raw, std::uint64_t& into, const IntegerKind& kind, Refusal& refusal);
bool readValue(const JsonValue& raw, double& into, const NumberKind& kind, Refusal& refusal);
bool readValue(const JsonValue& raw, bool& into, const FlagKind& kind, Refusal& refusal);
bool readValue(const JsonValue& raw, std::string& into, const TextKind& kind, Refusal& refusal);
bool readValue(const JsonValue& raw, std::string& into, const ChoiceKind& kind, Refusal& refusal);
bool readValue(const JsonValue& raw, Vec3& into, const PositionKind& kind, Refusal& refusal);
bool readValue(const JsonValue& raw, ProtocolVersion& into, const VersionKind& kind, Refusal& refusal);
bool readValue(const JsonValue& raw, std::vector<ProtocolVersion>& into, const VersionsKind& kind, Refusal& refusal);
bool readValue(const JsonValue& raw, std::vector<NamedNumber>& into, const NumbersKind& kind, Refusal& refusal);

template <typename Row>
bool readValue(const JsonValue&, std::vector<Row>& read, const RowsKind& kind, Refusal& refusal) {
  return checkValue(read, kind, refusal);
}

template <typename Part>
bool readValue(const JsonValue&, Part&, const PartKind&, Refusal&) {
  return true;
}

template <typename Part>
bool readValue(const JsonValue&, std::vector<Part>&, const PartsKind&, Refusal&) {
  return true;
}

// ---- both

struct LayoutPass {
  const JsonValue& raw;
  Refusal& refusal;

  template <typename Value, typename Kind>
  bool field(const char* name, Value& into, const Kind& kind) {
    const JsonValue value = raw.member(name);
    if (value.isNothing()) return refuse(refusal, "got nothing, expected a value", name);
    return readLayout(value, into, kind, refusal) || refusedBelow(refusal, name);
  }

  template <typename Value, typename Kind>
  bool field(const char* name, std::optional<Value>& into, const Kind& kind) {
    const JsonValue value = raw.member(name);
    into.reset();
    if (value.isNothing()) return true;
    return readLayout(value, into.emplace(), kind, refusal) || refusedBelow(refusal, name);
  }
};

struct ValuePass {
  const JsonValue& raw;
  Refusal& refusal;

  template <typename Value, typename Kind>
  bool field(const char* name, Value& into, const Kind& kind) {
    return readValue(raw.member(name), into, kind, refusal) || refusedBelow(refusal, name);
  }

  template <typename Value, typename Kind>
  bool field(const char* name, std::optional<Value>& into, const Kind& kind) {
    return !into.has_value() || readValue(raw.member(name), *into, kind, refusal) || refusedBelow(refusal, name);
  }
};

/// Read the fields of a map; unknown keys are skipped, null is absent. On failure `refusal` says why and where.
template <typename Message>
bool readFields(const JsonValue& raw, Message& into, Refusal& refusal) {
  if (!raw.isMap()) return refuse(refusal, "expected a map");
  LayoutPass layout{raw, refusal};
  if (!FieldsOf<Message>::visit(layout, into)) return false;
  ValuePass values{raw, refusal};
  return FieldsOf<Message>::visit(values, into);
}

}  // namespace terraport
