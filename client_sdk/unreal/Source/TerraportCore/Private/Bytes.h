// Numbers of the wire at any address, whatever the machine's byte order. `Le`: least significant byte first.
#pragma once

#include <cstdint>
#include <cstring>
#include <string>

namespace terraport {

inline std::uint32_t readU16Le(const std::uint8_t* at) {
  return at[0] | (static_cast<std::uint32_t>(at[1]) << 8);
}

inline std::uint32_t readU32Le(const std::uint8_t* at) {
  return readU16Le(at) | (readU16Le(at + 2) << 16);
}

inline std::uint64_t readU64Le(const std::uint8_t* at) {
  return readU32Le(at) | (static_cast<std::uint64_t>(readU32Le(at + 4)) << 32);
}

inline float readF32Le(const std::uint8_t* at) {
  const std::uint32_t bits = readU32Le(at);
  float value = 0;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}

/// A number of so many bytes, most significant first.
inline std::uint64_t readBe(const std::uint8_t* at, unsigned width) {
  std::uint64_t value = 0;
  for (unsigned number = 0; number < width; ++number) value = (value << 8) | at[number];
  return value;
}

inline void appendLe(std::uint64_t value, unsigned width, std::string& into) {
  for (unsigned number = 0; number < width; ++number) into.push_back(static_cast<char>(value >> (8 * number)));
}

inline void appendBe(std::uint64_t value, unsigned width, std::string& into) {
  for (unsigned number = width; number > 0; --number) into.push_back(static_cast<char>(value >> (8 * (number - 1))));
}

inline void appendF32Le(float value, std::string& into) {
  std::uint32_t bits = 0;
  std::memcpy(&bits, &value, sizeof bits);
  appendLe(bits, 4, into);
}

}  // namespace terraport
