#include "Bytes.h"
#include "Msgpack.h"
#include "Utf8.h"

#include <algorithm>
#include <cstdio>

namespace terraport {

namespace {

constexpr std::uint64_t kMaxInteger = (std::uint64_t{1} << 53) - 1;
/// Items of one list or map.
constexpr std::uint64_t kMaxItems = 16384;
constexpr std::uint32_t kNoNode = 0xFFFFFFFF;

}  // namespace

/// One reading of one message.
class MsgpackReader {
 public:
  MsgpackReader(ByteSpan data, const JsonLimits& limits, JsonDocument& document)
      : data_(data), limits_(limits), document_(document) {}

  Status read() {
    document_.clear();
    if (data_.size > std::min<std::size_t>(limits_.maxBytes, 0x7FFFFFFF)) {
      fail("got a message that is too long", 0);
    } else {
      document_.source_ = {reinterpret_cast<const char*>(data_.data), data_.size};
      if (value(0) && at_ != data_.size) fail("got bytes after the message, expected none", at_);
    }
    if (error_.empty()) return Status::ok();
    document_.clear();
    return Status::failed("malformed", error_, static_cast<std::int64_t>(errorAt_));
  }

 private:
  using Node = JsonDocument::Node;

  bool fail(std::string text, std::size_t at) {
    if (error_.empty()) {
      error_ = std::move(text);
      errorAt_ = at;
    }
    return false;
  }

  Node* add(JsonKind kind) {
    if (document_.nodes_.size() >= limits_.maxValues) {
      fail("got too many values", at_);
      return nullptr;
    }
    Node node;
    node.kind = kind;
    node.after = static_cast<std::uint32_t>(document_.nodes_.size()) + 1;
    document_.nodes_.push_back(node);
    return &document_.nodes_.back();
  }

  /// Move on by so many bytes, which must be there.
  bool take(std::uint64_t length, std::size_t& start) {
    start = at_;
    if (length > data_.size - at_) {
      return fail(
          "got " + std::to_string(data_.size - at_) + " bytes, expected " + std::to_string(length) + " of a value", at_);
    }
    at_ += static_cast<std::size_t>(length);
    return true;
  }

  bool unsignedOf(unsigned width, std::uint64_t& number) {
    std::size_t start = 0;
    if (!take(width, start)) return false;
    number = readBe(data_.data + start, width);
    return true;
  }

  /// `depth` counts the maps and lists around the value.
  bool value(std::uint32_t depth) {
    const std::size_t start = at_;
    std::uint64_t token = 0;
    if (!unsignedOf(1, token)) return false;
    // 1. Tokens that hold their number themselves.
    if (token <= 0x7F) return integer(static_cast<std::int64_t>(token));
    if (token >= 0xE0) return integer(static_cast<std::int64_t>(token) - 0x100);
    if (token <= 0x8F) return map(token & 0x0F, depth, start);
    if (token <= 0x9F) return list(token & 0x0F, depth, start);
    if (token <= 0xBF) return bytes(JsonKind::Text, token & 0x1F);
    // 2. Nothing, flags, and tokens with a number of 1, 2, 4 or 8 bytes behind them. Ext types are refused: no message has one.
    switch (token) {
      case 0xC0:
        return add(JsonKind::Null) != nullptr;
      case 0xC2:
      case 0xC3:
        return flag(token == 0xC3);
      case 0xC4:
      case 0xC5:
      case 0xC6:
        return counted(1u << (token - 0xC4), [this](std::uint64_t count) { return bytes(JsonKind::Binary, count); });
      case 0xCA:
      case 0xCB:
        return real(token == 0xCA ? 4 : 8);
      case 0xCC:
      case 0xCD:
      case 0xCE:
      case 0xCF:
        return counted(1u << (token - 0xCC), [this](std::uint64_t number) { return natural(number); });
      case 0xD0:
      case 0xD1:
      case 0xD2:
      case 0xD3:
        return negative(1u << (token - 0xD0));
      case 0xD9:
      case 0xDA:
      case 0xDB:
        return counted(1u << (token - 0xD9), [this](std::uint64_t count) { return bytes(JsonKind::Text, count); });
      case 0xDC:
      case 0xDD:
        return counted(token == 0xDC ? 2 : 4, [this, depth, start](std::uint64_t count) { return list(count, depth, start); });
      case 0xDE:
      case 0xDF:
        return counted(token == 0xDE ? 2 : 4, [this, depth, start](std::uint64_t count) { return map(count, depth, start); });
      default: {
        char text[64];
        std::snprintf(text, sizeof text, "got msgpack token 0x%02x, which no message uses", static_cast<unsigned>(token));
        return fail(text, start);
      }
    }
  }

  /// Read a number of so many bytes, and go on with it.
  template <typename Use>
  bool counted(unsigned width, Use use) {
    std::uint64_t number = 0;
    return unsignedOf(width, number) && use(number);
  }

  bool flag(bool isTrue) {
    Node* const node = add(JsonKind::Boolean);
    if (node == nullptr) return false;
    node->flags = isTrue ? JsonDocument::kTrue : 0;
    return true;
  }

  bool integer(std::int64_t whole) {
    Node* const node = add(JsonKind::Integer);
    if (node == nullptr) return false;
    node->whole = whole;
    return true;
  }

  bool rounded(double value) {
    Node* const node = add(JsonKind::Integer);
    if (node == nullptr) return false;
    node->flags = JsonDocument::kRounded;
    node->real = value;
    return true;
  }

  bool natural(std::uint64_t number) {
    return number <= kMaxInteger ? integer(static_cast<std::int64_t>(number)) : rounded(static_cast<double>(number));
  }

  bool negative(unsigned width) {
    std::uint64_t bits = 0;
    if (!unsignedOf(width, bits)) return false;
    const std::uint64_t sign = std::uint64_t{1} << (8 * width - 1);
    if ((bits & sign) == 0) return natural(bits);
    // The size of a negative number: its complement and one, in so many bits.
    const std::uint64_t mask = sign | (sign - 1);
    const std::uint64_t size = (~bits & mask) + 1;
    return size <= kMaxInteger ? integer(-static_cast<std::int64_t>(size)) : rounded(-static_cast<double>(size));
  }

  bool real(unsigned width) {
    std::uint64_t bits = 0;
    if (!unsignedOf(width, bits)) return false;
    double wide = 0;
    if (width == 4) {
      const auto narrowBits = static_cast<std::uint32_t>(bits);
      float narrow = 0;
      std::memcpy(&narrow, &narrowBits, sizeof narrow);
      wide = static_cast<double>(narrow);
    } else {
      std::memcpy(&wide, &bits, sizeof wide);
    }
    Node* const node = add(JsonKind::Float);
    if (node == nullptr) return false;
    node->real = wide;
    return true;
  }

  bool bytes(JsonKind kind, std::uint64_t length) {
    std::size_t start = 0;
    if (!take(length, start)) return false;
    Node* const node = add(kind);
    if (node == nullptr) return false;
    node->offset = static_cast<std::uint32_t>(start);
    node->length = static_cast<std::uint32_t>(length);
    return kind == JsonKind::Binary || isUtf8(document_.textOf(*node)) || fail("got text that is not UTF-8", start);
  }

  bool list(std::uint64_t count, std::uint32_t depth, std::size_t start) {
    const std::uint32_t index = enter(JsonKind::List, count, depth, start);
    if (index == kNoNode) return false;
    for (std::uint64_t number = 0; number < count; ++number) {
      if (!value(depth + 1)) return false;
    }
    document_.nodes_[index].after = static_cast<std::uint32_t>(document_.nodes_.size());
    return true;
  }

  bool map(std::uint64_t count, std::uint32_t depth, std::size_t start) {
    const std::uint32_t index = enter(JsonKind::Map, count, depth, start);
    if (index == kNoNode) return false;
    for (std::uint64_t number = 0; number < count; ++number) {
      const std::size_t at = at_;
      const std::size_t key = document_.nodes_.size();
      if (!value(depth + 1)) return false;
      if (document_.nodes_[key].kind != JsonKind::Text) return fail("got a key that is no text", at);
      if (!value(depth + 1)) return false;
    }
    document_.nodes_[index].after = static_cast<std::uint32_t>(document_.nodes_.size());
    return !document_.hasKeyTwice(index) || fail("got a key twice, expected each key once", start);
  }

  std::uint32_t enter(JsonKind kind, std::uint64_t count, std::uint32_t depth, std::size_t start) {
    if (count > kMaxItems) {
      fail("got " + std::to_string(count) + " items, expected at most " + std::to_string(kMaxItems), start);
      return kNoNode;
    }
    if (depth + 1 > limits_.maxDepth) {
      fail("got nesting beyond " + std::to_string(limits_.maxDepth) + " levels", start);
      return kNoNode;
    }
    Node* const node = add(kind);
    if (node == nullptr) return kNoNode;
    node->length = static_cast<std::uint32_t>(count);
    return node->after - 1;
  }

  const ByteSpan data_;
  const JsonLimits& limits_;
  JsonDocument& document_;
  std::size_t at_ = 0;
  std::string error_;
  std::size_t errorAt_ = 0;
};

Status readMsgpack(ByteSpan data, const JsonLimits& limits, JsonDocument& into) {
  return MsgpackReader(data, limits, into).read();
}

}  // namespace terraport
