// Numbers out of bytes, least significant byte first, at any address.
#pragma once

#include <cstdint>
#include <cstring>

namespace terraport {

inline std::uint16_t readU16(const std::uint8_t* at) {
  return static_cast<std::uint16_t>(at[0] | (at[1] << 8));
}

inline std::uint32_t readU32(const std::uint8_t* at) {
  return at[0] | (std::uint32_t{at[1]} << 8) | (std::uint32_t{at[2]} << 16) | (std::uint32_t{at[3]} << 24);
}

inline std::uint64_t readU64(const std::uint8_t* at) {
  return readU32(at) | (std::uint64_t{readU32(at + 4)} << 32);
}

/// Most significant byte first.
inline std::uint32_t readU32Big(const std::uint8_t* at) {
  return at[3] | (std::uint32_t{at[2]} << 8) | (std::uint32_t{at[1]} << 16) | (std::uint32_t{at[0]} << 24);
}

/// Most significant byte first.
inline std::uint16_t readU16Big(const std::uint8_t* at) {
  return static_cast<std::uint16_t>(at[1] | (at[0] << 8));
}

}  // namespace terraport
