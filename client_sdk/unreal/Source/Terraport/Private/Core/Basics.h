// Values that all parts of the engine-free core share. Lengths are metres of the scene frame: right-handed, x east, y up,
// z south. The core throws nothing: failures are values of type Status.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace terraport {

using Bytes = std::vector<std::uint8_t>;

/// Bytes that a cache may drop while a decoder still reads them.
using SharedBytes = std::shared_ptr<const Bytes>;

/// A view; the owner of the bytes keeps them alive while it is used.
struct ByteSpan {
  ByteSpan() = default;
  ByteSpan(const std::uint8_t* data_, std::size_t size_) : data(data_), size(size_) {}
  ByteSpan(const Bytes& bytes) : data(bytes.data()), size(bytes.size()) {}  // Not explicit: all bytes are a view of them.

  const std::uint8_t* data = nullptr;
  std::size_t size = 0;
};

/// A position or a direction.
struct Vec3 {
  double x = 0.0;
  double y = 0.0;
  double z = 0.0;
};

/// An axis-aligned box.
struct Box {
  float low[3] = {0.0F, 0.0F, 0.0F};
  float high[3] = {0.0F, 0.0F, 0.0F};
};

/// Success, or a failure with a code for programs and a message for people: what was received, what was expected.
///
/// Codes are those of the wire protocol, and `damaged`, `unsupported_version`, `invalid_url`, `unreachable`, `refused`,
/// `several_scenes`.
class [[nodiscard]] Status {
 public:
  Status() = default;
  static Status failed(std::string code, std::string message) {
    Status status;
    status.code_ = std::move(code);
    status.message_ = std::move(message);
    return status;
  }
  static Status damaged(std::string message) { return failed("damaged", std::move(message)); }

  bool isOk() const { return code_.empty(); }
  const std::string& code() const { return code_; }
  const std::string& message() const { return message_; }

 private:
  std::string code_;
  std::string message_;
};

/// Little-endian numbers at any address.
inline std::uint16_t readU16(const std::uint8_t* at) {
  return static_cast<std::uint16_t>(at[0] | (at[1] << 8));
}
inline std::uint32_t readU32(const std::uint8_t* at) {
  return readU16(at) | (std::uint32_t{readU16(at + 2)} << 16);
}
inline std::uint64_t readU64(const std::uint8_t* at) {
  return readU32(at) | (std::uint64_t{readU32(at + 4)} << 32);
}

/// Sixteen lower-case hexadecimal digits, the most significant first.
inline std::string hexOf(std::uint64_t number) {
  std::string text(16, '0');
  for (std::size_t at = 16; at-- > 0; number >>= 4) text[at] = "0123456789abcdef"[number & 15];
  return text;
}

}  // namespace terraport
