// A message as the corpus states it (wire protocol, section 15): beside its map, with tables as lists of rows.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <optional>
#include <string>
#include <string_view>

#include "Bytes.h"
#include "Terraport/Json.h"

namespace terraport::tools {

/// Append a row as it stands on the wire: an id, `[id, "hash"]`, or the object of a segment to load.
inline void appendRow(const JsonValue& stated, std::string& into) {
  const auto number = [&into](const JsonValue& value) { appendLe(static_cast<std::uint64_t>(*value.integer()), 4, into); };
  const auto hash = [&into](const JsonValue& value) {
    appendLe(std::strtoull(std::string(*value.text()).c_str(), nullptr, 16), 8, into);
  };
  if (stated.isList()) {
    auto item = stated.items().begin();
    number(*item);
    hash(*++item);
  } else if (stated.isMap()) {
    number(stated.member("id"));
    number(stated.member("length"));
    hash(stated.member("xxh3"));
    number(stated.member("faces"));
    number(stated.member("vertices"));
    for (const JsonValue side : stated.member("bounds").items()) appendF32Le(static_cast<float>(*side.number()), into);
  } else {
    number(stated);
  }
}

/// Whether a message's value is the stated one; the order of members has no meaning, nor has 60 against 60.0.
inline bool isAsStated(const JsonValue& value, const JsonValue& stated) {
  if (const std::optional<ByteSpan> binary = value.binary()) {
    std::string rows;
    for (const JsonValue row : stated.items()) appendRow(row, rows);
    return stated.isList() && rows == std::string_view(reinterpret_cast<const char*>(binary->data), binary->size);
  }
  if (value.number() && stated.number()) return *value.number() == *stated.number();
  if (value.kind() != stated.kind() || value.size() != stated.size()) return false;
  const JsonValue::Range items = value.items();
  auto match = stated.items().begin();
  for (auto item = items.begin(); item != items.end(); ++item) {
    const JsonValue counterpart = value.isMap() ? stated.member(item.key()) : *match;
    if (!counterpart.exists() || !isAsStated(*item, counterpart)) return false;
    ++match;
  }
  return value.text() == stated.text() && value.boolean() == stated.boolean();
}

}  // namespace terraport::tools
