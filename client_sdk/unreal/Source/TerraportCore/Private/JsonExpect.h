// Values out of a JSON document, each looked at for what it is before it is used.
#pragma once

#include <cfloat>
#include <cmath>
#include <cstdint>
#include <string>
#include <string_view>

#include "Terraport/Json.h"
#include "Terraport/Status.h"

namespace terraport {

/// A bound for arithmetic, far above any segment: 134 M rows of 16 bytes.
constexpr std::int64_t kMostWhole = std::int64_t{1} << 31;

/// Show a value in an error text, a few dozen characters of it at most.
inline std::string shortly(JsonValue value) {
  if (!value.exists()) {
    return "missing";
  }
  switch (value.kind()) {
    case JsonKind::Null:
      return "null";
    case JsonKind::Boolean:
      return value.boolean().value_or(false) ? "true" : "false";
    case JsonKind::List:
      return "a list";
    case JsonKind::Map:
      return "an object";
    case JsonKind::Text: {
      const std::string_view text = value.text().value_or("");
      return "\"" + std::string(text.substr(0, 48)) + "\"";
    }
    default:
      break;
  }
  if (const auto whole = value.integer()) {
    return std::to_string(*whole);
  }
  const auto number = value.number();
  return number ? std::to_string(*number) : "a number beyond float64";
}

/// Its index is a failure where the value is no object.
inline Status expectMap(JsonValue value, std::string_view label) {
  if (value.isMap()) {
    return {};
  }
  return Status::damaged(std::string(label) + " is " + shortly(value) + ", expected an object");
}

/// Absent counts as an object without members: every question to it answers "nothing".
inline Status expectMapOrAbsent(JsonValue value, std::string_view label) {
  return value.exists() ? expectMap(value, label) : Status();
}

inline Status expectList(JsonValue value, std::string_view label) {
  if (value.isList()) {
    return {};
  }
  return Status::damaged(std::string(label) + " is " + shortly(value) + ", expected a list");
}

inline Status expectListOrAbsent(JsonValue value, std::string_view label) {
  return value.exists() ? expectList(value, label) : Status();
}

/// Read a whole number from `least` to kMostWhole; damaged where it is none.
inline Status expectWhole(JsonValue value, std::string_view label, std::int64_t least, std::uint64_t& out) {
  const auto whole = value.integer();
  if (whole && *whole >= least && *whole <= kMostWhole) {
    out = static_cast<std::uint64_t>(*whole);
    return {};
  }
  return Status::damaged(std::string(label) + " is " + shortly(value) + ", expected a whole number from " +
      std::to_string(least) + " to " + std::to_string(kMostWhole));
}

/// As expectWhole; `fallback` where the value is absent.
inline Status expectWholeOr(
    JsonValue value, std::string_view label, std::int64_t least, std::uint64_t fallback, std::uint64_t& out) {
  out = fallback;
  return value.exists() ? expectWhole(value, label, least, out) : Status();
}

inline Status expectNumber(JsonValue value, std::string_view label, double& out) {
  const auto number = value.number();
  if (number && std::isfinite(*number)) {
    out = *number;
    return {};
  }
  return Status::damaged(std::string(label) + " is " + shortly(value) + ", expected a finite number");
}

/// Read offset and step of an attribute's codes; damaged where a code from 0 to 65534 has no value in float32.
inline Status expectScale(JsonValue attribute, double& offset, double& step) {
  TERRAPORT_RETURN_IF_ERROR(expectNumber(attribute.member("offset"), "offset of an attribute", offset));
  TERRAPORT_RETURN_IF_ERROR(expectNumber(attribute.member("step"), "step of an attribute", step));
  if (!(step > 0.0) || !(std::fabs(offset) <= FLT_MAX) || !(std::fabs(offset + step * 65534.0) <= FLT_MAX)) {
    return Status::damaged("scale of an attribute, expected a step above 0 and all values within float32");
  }
  return {};
}

inline Status expectTriple(JsonValue value, std::string_view label, double out[3]) {
  TERRAPORT_RETURN_IF_ERROR(expectList(value, label));
  if (value.size() != 3) {
    return Status::damaged(std::string(label) + " has " + std::to_string(value.size()) + " numbers, expected 3");
  }
  int at = 0;
  for (const JsonValue component : value.items()) {
    TERRAPORT_RETURN_IF_ERROR(expectNumber(component, label, out[at]));
    ++at;
  }
  return {};
}

/// The entry of a list with that number; absent where there is none.
inline JsonValue itemAt(JsonValue list, JsonValue number) {
  const auto whole = number.integer();
  if (!whole || *whole < 0 || !list.isList() || *whole >= static_cast<std::int64_t>(list.size())) {
    return {};
  }
  std::int64_t remaining = *whole;
  for (const JsonValue item : list.items()) {
    if (remaining == 0) {
      return item;
    }
    --remaining;
  }
  return {};
}

/// The object with that number in a list.
inline Status pickMap(JsonValue list, JsonValue number, std::string_view label, JsonValue& out) {
  out = itemAt(list, number);
  if (!out.exists()) {
    return Status::damaged(std::string(label) + " is " + shortly(number) + ", expected 0 to " +
        std::to_string(static_cast<std::int64_t>(list.size()) - 1));
  }
  return expectMap(out, label);
}

/// The one entry of the list under `key`.
inline Status onlyMap(JsonValue owner, std::string_view key, JsonValue& out) {
  const JsonValue list = owner.member(key);
  TERRAPORT_RETURN_IF_ERROR(expectList(list, key));
  if (list.size() != 1) {
    return Status::damaged(std::to_string(list.size()) + " " + std::string(key) + ", expected 1");
  }
  out = *list.items().begin();
  return expectMap(out, key);
}

}  // namespace terraport
