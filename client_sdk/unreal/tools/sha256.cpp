#include "sha256.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <vector>

namespace terraport::tools {
namespace {

std::uint32_t turned(std::uint32_t word, int by) {
  return word >> by | word << (32 - by);
}

/// The first 32 bits of the fractional part of a root of each of the first primes (sections 4.2.2, 5.3.3).
template <std::size_t Count>
std::array<std::uint32_t, Count> rootsOfPrimes(double (*root)(double)) {
  std::array<std::uint32_t, Count> words{};
  std::size_t count = 0;
  for (int number = 2; count < Count; ++number) {
    bool isPrime = true;
    for (int factor = 2; factor * factor <= number; ++factor) {
      isPrime = isPrime && number % factor != 0;
    }
    if (isPrime) {
      const double value = root(number);
      words[count++] = static_cast<std::uint32_t>((value - std::floor(value)) * 4294967296.0);
    }
  }
  return words;
}

}  // namespace

std::string sha256(const std::uint8_t* data, std::size_t size) {
  // 1. Padding to whole blocks of 64 bytes, the length in bits last (section 5.1.1).
  static const auto constants = rootsOfPrimes<64>(std::cbrt);
  auto state = rootsOfPrimes<8>(std::sqrt);
  std::vector<std::uint8_t> padded(data, data + size);
  padded.push_back(0x80);
  while (padded.size() % 64 != 56) {
    padded.push_back(0);
  }
  for (int shift = 56; shift >= 0; shift -= 8) {
    padded.push_back(static_cast<std::uint8_t>(std::uint64_t{size} * 8 >> shift));
  }
  // 2. Block by block: its schedule of 64 words, and 64 rounds over the state (section 6.2.2).
  for (std::size_t block = 0; block < padded.size(); block += 64) {
    std::uint32_t words[64];
    for (std::size_t at = 0; at < 16; ++at) {
      const std::uint8_t* bytes = &padded[block + 4 * at];
      words[at] = std::uint32_t{bytes[0]} << 24 | std::uint32_t{bytes[1]} << 16 | std::uint32_t{bytes[2]} << 8 | bytes[3];
    }
    for (std::size_t at = 16; at < 64; ++at) {
      const std::uint32_t word15 = words[at - 15];
      const std::uint32_t word2 = words[at - 2];
      words[at] = words[at - 16] + (turned(word15, 7) ^ turned(word15, 18) ^ word15 >> 3) + words[at - 7] +
          (turned(word2, 17) ^ turned(word2, 19) ^ word2 >> 10);
    }
    auto [a, b, c, d, e, f, g, h] = state;
    for (std::size_t at = 0; at < 64; ++at) {
      const std::uint32_t first =
          h + (turned(e, 6) ^ turned(e, 11) ^ turned(e, 25)) + ((e & f) ^ (~e & g)) + constants[at] + words[at];
      const std::uint32_t second = (turned(a, 2) ^ turned(a, 13) ^ turned(a, 22)) + ((a & b) ^ (a & c) ^ (b & c));
      h = g, g = f, f = e, e = d + first, d = c, c = b, b = a, a = first + second;
    }
    const std::uint32_t sums[8] = {a, b, c, d, e, f, g, h};
    for (std::size_t at = 0; at < 8; ++at) {
      state[at] += sums[at];
    }
  }
  // 3. The state as text.
  std::string text;
  for (const std::uint32_t word : state) {
    char digits[9];
    std::snprintf(digits, sizeof digits, "%08x", static_cast<unsigned>(word));
    text += digits;
  }
  return text;
}

}  // namespace terraport::tools
