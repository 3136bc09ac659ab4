// One msgpack value to and from bytes: the part of the format that messages use, and no more.
#pragma once

#include "Terraport/Json.h"
#include "Terraport/Status.h"

#include <cstdint>
#include <string>
#include <string_view>

namespace terraport {

/// Read exactly one value into a document, as if it had been JSON; binaries are views of `data`, which must outlive the
/// document or its next use. Nothing is reserved for a length that the bytes at hand do not have.
/// Error code: `malformed`, with the byte where: cut off, nested or counted beyond the limits, a token that no message uses,
/// a key that is no text or stands twice, text that is no UTF-8, bytes after the end.
Status readMsgpack(ByteSpan data, const JsonLimits& limits, JsonDocument& into);

/// Writes values one after the other: every integer in its shortest form, every float in 64 bits.
class MsgpackWriter {
 public:
  explicit MsgpackWriter(std::string& into) : into_(into) {}

  /// `count` members follow, each a key and a value.
  void beginMap(std::size_t count) { head(count, 0x80, 15, 0, 0xDE); }
  void beginList(std::size_t count) { head(count, 0x90, 15, 0, 0xDC); }
  void key(std::string_view name) { text(name); }
  void text(std::string_view value);
  void integer(std::uint64_t value);
  void real(double value);
  void flag(bool value) { into_.push_back(static_cast<char>(value ? 0xC3 : 0xC2)); }
  /// So many bytes follow: append them to the string.
  void beginBinary(std::size_t size) { head(size, 0, 0, 0xC4, 0xC5); }

 private:
  /// A token with its count: in the token itself below `shortBelow`, else in 8 (where there is such a form), 16, 32 bits.
  void head(std::size_t count, unsigned shortToken, std::size_t shortMost, unsigned token8, unsigned token16);

  std::string& into_;
};

}  // namespace terraport
