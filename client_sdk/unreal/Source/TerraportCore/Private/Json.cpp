#include "Terraport/Json.h"

#include <algorithm>
#include <cmath>

namespace terraport {

namespace {

/// Maps up to this size are searched for repeated keys pair by pair.
constexpr std::uint32_t kFewKeys = 8;

}  // namespace

void JsonDocument::clear() {
  nodes_.clear();
  decoded_.clear();
  source_ = {};
}

std::string_view JsonDocument::textOf(const Node& node) const {
  const std::string_view buffer = (node.flags & kDecoded) != 0 ? std::string_view(decoded_) : source_;
  return buffer.substr(node.offset, node.length);
}

bool JsonDocument::hasKeyTwice(std::uint32_t map) const {
  const std::uint32_t count = nodes_[map].length;
  if (count < 2) return false;
  keys_.clear();
  std::uint32_t at = map + 1;
  for (std::uint32_t number = 0; number < count; ++number) {
    keys_.push_back(textOf(nodes_[at]));
    at = nodes_[at + 1].after;
  }
  if (count <= kFewKeys) {
    for (std::uint32_t key = 1; key < count; ++key) {
      for (std::uint32_t earlier = 0; earlier < key; ++earlier) {
        if (keys_[key] == keys_[earlier]) return true;
      }
    }
    return false;
  }
  std::sort(keys_.begin(), keys_.end());
  return std::adjacent_find(keys_.begin(), keys_.end()) != keys_.end();
}

JsonKind JsonValue::kind() const {
  return exists() ? document_->nodes_[index_].kind : JsonKind::Null;
}

std::optional<bool> JsonValue::boolean() const {
  if (kind() != JsonKind::Boolean) return std::nullopt;
  return (document_->nodes_[index_].flags & JsonDocument::kTrue) != 0;
}

std::optional<std::int64_t> JsonValue::integer() const {
  if (kind() != JsonKind::Integer) return std::nullopt;
  const JsonDocument::Node& node = document_->nodes_[index_];
  if ((node.flags & (JsonDocument::kUnread | JsonDocument::kRounded)) != 0) return std::nullopt;
  return node.whole;
}

std::optional<double> JsonValue::number() const {
  const JsonKind actualKind = kind();
  if (actualKind != JsonKind::Integer && actualKind != JsonKind::Float) return std::nullopt;
  const JsonDocument::Node& node = document_->nodes_[index_];
  double value = 0;
  if ((node.flags & JsonDocument::kUnread) != 0) {
    value = readDecimal(document_->textOf(node));
  } else if (actualKind == JsonKind::Integer && (node.flags & JsonDocument::kRounded) == 0) {
    value = static_cast<double>(node.whole);
  } else {
    value = node.real;
  }
  if (!std::isfinite(value)) return std::nullopt;
  return value;
}

std::optional<std::string_view> JsonValue::text() const {
  if (kind() != JsonKind::Text) return std::nullopt;
  return document_->textOf(document_->nodes_[index_]);
}

std::optional<ByteSpan> JsonValue::binary() const {
  if (kind() != JsonKind::Binary) return std::nullopt;
  const std::string_view bytes = document_->textOf(document_->nodes_[index_]);
  return ByteSpan{reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()};
}

std::uint32_t JsonValue::size() const {
  return isMap() || isList() ? document_->nodes_[index_].length : 0;
}

JsonValue JsonValue::member(std::string_view key) const {
  if (!isMap()) return {};
  const std::uint32_t count = document_->nodes_[index_].length;
  std::uint32_t at = index_ + 1;
  for (std::uint32_t number = 0; number < count; ++number) {
    if (document_->textOf(document_->nodes_[at]) == key) return JsonValue(document_, at + 1);
    at = document_->nodes_[at + 1].after;
  }
  return {};
}

JsonValue::Range JsonValue::items() const {
  Range range;
  if (!isMap() && !isList()) return range;
  range.begin_.document_ = document_;
  range.begin_.index_ = index_ + 1;
  range.begin_.left_ = document_->nodes_[index_].length;
  range.begin_.isMap_ = isMap();
  return range;
}

std::string_view JsonValue::Iterator::key() const {
  return isMap_ ? document_->textOf(document_->nodes_[index_]) : std::string_view();
}

JsonValue::Iterator& JsonValue::Iterator::operator++() {
  index_ = document_->nodes_[isMap_ ? index_ + 1 : index_].after;
  left_ -= 1;
  return *this;
}

}  // namespace terraport
