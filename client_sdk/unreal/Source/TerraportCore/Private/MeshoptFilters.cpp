// Filters of EXT_meshopt_compression (specification, appendix B).
#include <cmath>
#include <cstring>

#include "LittleEndian.h"
#include "Meshopt.h"

namespace terraport {
namespace {

std::uint8_t rounded(float value) {
  // Halves away from zero; |value| is at most 127 but for float32's own rounding.
  const int rounded = static_cast<int>(value + (value >= 0.0F ? 0.5F : -0.5F));
  return static_cast<std::uint8_t>(static_cast<std::int8_t>(rounded));
}

}  // namespace

void meshoptUnfilterOctahedral(std::uint8_t* rows, std::size_t count) {
  for (std::size_t row = 0; row < count; ++row, rows += 4) {
    float x = static_cast<std::int8_t>(rows[0]);
    float y = static_cast<std::int8_t>(rows[1]);
    const float z = static_cast<float>(static_cast<std::int8_t>(rows[2])) - std::fabs(x) - std::fabs(y);
    // The lower half lies in the square's corners.
    const float fold = z < 0.0F ? z : 0.0F;
    x += x >= 0.0F ? fold : -fold;
    y += y >= 0.0F ? fold : -fold;
    const float length = std::sqrt(x * x + y * y + z * z);
    if (!(length > 0.0F)) {
      rows[0] = rows[1] = rows[2] = 0;
      continue;
    }
    const float scale = 127.0F / length;
    rows[0] = rounded(x * scale);
    rows[1] = rounded(y * scale);
    rows[2] = rounded(z * scale);
  }
}

void meshoptUnfilterExponential(std::uint8_t* words, std::size_t count) {
  for (std::size_t word = 0; word < count; ++word, words += 4) {
    const std::uint32_t bits = readU32(words);
    // 24 bits with their sign, and 8 bits with theirs.
    const std::int32_t mantissa = static_cast<std::int32_t>((bits & 0xFFFFFFU) ^ 0x800000U) - 0x800000;
    const std::uint32_t exponent = ((bits >> 24) ^ 0x80U) - 0x80U;
    const std::uint32_t power = (exponent + 127U) << 23;
    float scale = 0.0F;
    std::memcpy(&scale, &power, sizeof scale);
    const float value = scale * static_cast<float>(mantissa);
    std::memcpy(words, &value, sizeof value);
  }
}

}  // namespace terraport
