// XXH3-64 with seed 0 and the default secret, after the specification (xxHash's doc/xxhash_spec.md, by Y. Collet).
#include "Terraport/Xxh3.h"

#include <cstddef>

#include "LittleEndian.h"

namespace terraport {
namespace {

constexpr std::uint64_t kPrime32A = 0x9E3779B1U;
constexpr std::uint64_t kPrime32B = 0x85EBCA77U;
constexpr std::uint64_t kPrime32C = 0xC2B2AE3DU;
constexpr std::uint64_t kPrime64A = 0x9E3779B185EBCA87ULL;
constexpr std::uint64_t kPrime64B = 0xC2B2AE3D27D4EB4FULL;
constexpr std::uint64_t kPrime64C = 0x165667B19E3779F9ULL;
constexpr std::uint64_t kPrime64D = 0x85EBCA77C2B2AE63ULL;
constexpr std::uint64_t kPrime64E = 0x27D4EB2F165667C5ULL;
constexpr std::uint64_t kMixA = 0x165667919E3779F9ULL;
constexpr std::uint64_t kMixB = 0x9FB21C651E98DF25ULL;

constexpr std::size_t kSecretBytes = 192;
constexpr std::size_t kStripeBytes = 64;
constexpr std::size_t kStripesPerBlock = (kSecretBytes - kStripeBytes) / 8;
constexpr std::size_t kBlockBytes = kStripeBytes * kStripesPerBlock;

constexpr std::uint8_t kSecret[kSecretBytes] = {
    0xb8,
    0xfe,
    0x6c,
    0x39,
    0x23,
    0xa4,
    0x4b,
    0xbe,
    0x7c,
    0x01,
    0x81,
    0x2c,
    0xf7,
    0x21,
    0xad,
    0x1c,
    0xde,
    0xd4,
    0x6d,
    0xe9,
    0x83,
    0x90,
    0x97,
    0xdb,
    0x72,
    0x40,
    0xa4,
    0xa4,
    0xb7,
    0xb3,
    0x67,
    0x1f,
    0xcb,
    0x79,
    0xe6,
    0x4e,
    0xcc,
    0xc0,
    0xe5,
    0x78,
    0x82,
    0x5a,
    0xd0,
    0x7d,
    0xcc,
    0xff,
    0x72,
    0x21,
    0xb8,
    0x08,
    0x46,
    0x74,
    0xf7,
    0x43,
    0x24,
    0x8e,
    0xe0,
    0x35,
    0x90,
    0xe6,
    0x81,
    0x3a,
    0x26,
    0x4c,
    0x3c,
    0x28,
    0x52,
    0xbb,
    0x91,
    0xc3,
    0x00,
    0xcb,
    0x88,
    0xd0,
    0x65,
    0x8b,
    0x1b,
    0x53,
    0x2e,
    0xa3,
    0x71,
    0x64,
    0x48,
    0x97,
    0xa2,
    0x0d,
    0xf9,
    0x4e,
    0x38,
    0x19,
    0xef,
    0x46,
    0xa9,
    0xde,
    0xac,
    0xd8,
    0xa8,
    0xfa,
    0x76,
    0x3f,
    0xe3,
    0x9c,
    0x34,
    0x3f,
    0xf9,
    0xdc,
    0xbb,
    0xc7,
    0xc7,
    0x0b,
    0x4f,
    0x1d,
    0x8a,
    0x51,
    0xe0,
    0x4b,
    0xcd,
    0xb4,
    0x59,
    0x31,
    0xc8,
    0x9f,
    0x7e,
    0xc9,
    0xd9,
    0x78,
    0x73,
    0x64,
    0xea,
    0xc5,
    0xac,
    0x83,
    0x34,
    0xd3,
    0xeb,
    0xc3,
    0xc5,
    0x81,
    0xa0,
    0xff,
    0xfa,
    0x13,
    0x63,
    0xeb,
    0x17,
    0x0d,
    0xdd,
    0x51,
    0xb7,
    0xf0,
    0xda,
    0x49,
    0xd3,
    0x16,
    0x55,
    0x26,
    0x29,
    0xd4,
    0x68,
    0x9e,
    0x2b,
    0x16,
    0xbe,
    0x58,
    0x7d,
    0x47,
    0xa1,
    0xfc,
    0x8f,
    0xf8,
    0xb8,
    0xd1,
    0x7a,
    0xd0,
    0x31,
    0xce,
    0x45,
    0xcb,
    0x3a,
    0x8f,
    0x95,
    0x16,
    0x04,
    0x28,
    0xaf,
    0xd7,
    0xfb,
    0xca,
    0xbb,
    0x4b,
    0x40,
    0x7e,
};

std::uint64_t secretAt(std::size_t at) {
  return readU64(kSecret + at);
}

std::uint64_t avalanche(std::uint64_t x) {
  x ^= x >> 37;
  x *= kMixA;
  return x ^ (x >> 32);
}

std::uint64_t avalancheOfXxh64(std::uint64_t x) {
  x ^= x >> 33;
  x *= kPrime64B;
  x ^= x >> 29;
  x *= kPrime64C;
  return x ^ (x >> 32);
}

std::uint64_t rotatedLeft(std::uint64_t x, int by) {
  return (x << by) | (x >> (64 - by));
}

std::uint64_t swapped(std::uint64_t x) {
  x = ((x >> 8) & 0x00FF00FF00FF00FFULL) | ((x & 0x00FF00FF00FF00FFULL) << 8);
  x = ((x >> 16) & 0x0000FFFF0000FFFFULL) | ((x & 0x0000FFFF0000FFFFULL) << 16);
  return (x >> 32) | (x << 32);
}

/// Lower and upper half of the product, folded. In 32-bit pieces: not every compiler has numbers of 128 bits.
std::uint64_t foldedProduct(std::uint64_t a, std::uint64_t b) {
  const std::uint64_t aLow = a & 0xFFFFFFFFU;
  const std::uint64_t aHigh = a >> 32;
  const std::uint64_t bLow = b & 0xFFFFFFFFU;
  const std::uint64_t bHigh = b >> 32;
  const std::uint64_t low = aLow * bLow;
  const std::uint64_t crossA = aHigh * bLow + (low >> 32);
  const std::uint64_t crossB = aLow * bHigh + (crossA & 0xFFFFFFFFU);
  const std::uint64_t high = aHigh * bHigh + (crossA >> 32) + (crossB >> 32);
  return ((crossB << 32) | (low & 0xFFFFFFFFU)) ^ high;
}

std::uint64_t hashUpTo16(const std::uint8_t* data, std::size_t size) {
  if (size > 8) {
    const std::uint64_t low = (secretAt(24) ^ secretAt(32)) ^ readU64(data);
    const std::uint64_t high = (secretAt(40) ^ secretAt(48)) ^ readU64(data + size - 8);
    return avalanche(size + swapped(low) + high + foldedProduct(low, high));
  }
  if (size >= 4) {
    const std::uint64_t first = readU32(data);
    const std::uint64_t last = readU32(data + size - 4);
    std::uint64_t value = (secretAt(8) ^ secretAt(16)) ^ (last | (first << 32));
    value ^= rotatedLeft(value, 49) ^ rotatedLeft(value, 24);
    value *= kMixB;
    value ^= (value >> 35) + size;
    value *= kMixB;
    return value ^ (value >> 28);
  }
  if (size > 0) {
    const std::uint32_t combined = data[size - 1] | (static_cast<std::uint32_t>(size) << 8) | (std::uint32_t{data[0]} << 16) |
        (std::uint32_t{data[size >> 1]} << 24);
    return avalancheOfXxh64(std::uint64_t{readU32(kSecret) ^ readU32(kSecret + 4)} ^ combined);
  }
  return avalancheOfXxh64(secretAt(56) ^ secretAt(64));
}

std::uint64_t mixed(const std::uint8_t* data, std::size_t secret) {
  return foldedProduct(readU64(data) ^ secretAt(secret), readU64(data + 8) ^ secretAt(secret + 8));
}

std::uint64_t hashUpTo240(const std::uint8_t* data, std::size_t size) {
  std::uint64_t sum = size * kPrime64A;
  if (size <= 128) {
    for (std::size_t round = (size - 1) / 32 + 1; round > 0; --round) {
      const std::size_t at = (round - 1) * 16;
      sum += mixed(data + at, at * 2);
      sum += mixed(data + size - at - 16, at * 2 + 16);
    }
    return avalanche(sum);
  }
  for (std::size_t chunk = 0; chunk < 8; ++chunk) {
    sum += mixed(data + chunk * 16, chunk * 16);
  }
  sum = avalanche(sum);
  for (std::size_t chunk = 8; chunk < size / 16; ++chunk) {
    sum += mixed(data + chunk * 16, (chunk - 8) * 16 + 3);
  }
  return avalanche(sum + mixed(data + size - 16, 119));
}

void accumulate(std::uint64_t* sums, const std::uint8_t* stripe, std::size_t secret) {
  std::uint64_t lanes[8];
  for (std::size_t lane = 0; lane < 8; ++lane) {
    lanes[lane] = readU64(stripe + lane * 8);
  }
  for (std::size_t lane = 0; lane < 8; ++lane) {
    const std::uint64_t value = lanes[lane] ^ secretAt(secret + lane * 8);
    sums[lane] += lanes[lane ^ 1] + (value & 0xFFFFFFFFU) * (value >> 32);
  }
}

std::uint64_t hashLong(const std::uint8_t* data, std::size_t size) {
  std::uint64_t sums[8] = {kPrime32C, kPrime64A, kPrime64B, kPrime64C, kPrime64D, kPrime32B, kPrime64E, kPrime32A};
  const std::size_t blocks = (size - 1) / kBlockBytes;
  for (std::size_t block = 0; block < blocks; ++block) {
    const std::uint8_t* at = data + block * kBlockBytes;
    for (std::size_t stripe = 0; stripe < kStripesPerBlock; ++stripe) {
      accumulate(sums, at + stripe * kStripeBytes, stripe * 8);
    }
    for (std::size_t lane = 0; lane < 8; ++lane) {
      sums[lane] = ((sums[lane] ^ (sums[lane] >> 47)) ^ secretAt(kSecretBytes - kStripeBytes + lane * 8)) * kPrime32A;
    }
  }
  const std::uint8_t* tail = data + blocks * kBlockBytes;
  const std::size_t stripes = (size - blocks * kBlockBytes - 1) / kStripeBytes;
  for (std::size_t stripe = 0; stripe < stripes; ++stripe) {
    accumulate(sums, tail + stripe * kStripeBytes, stripe * 8);
  }
  // The last 64 bytes, whether some of them were in a stripe before or not.
  accumulate(sums, data + size - kStripeBytes, kSecretBytes - kStripeBytes - 7);
  std::uint64_t result = size * kPrime64A;
  for (std::size_t pair = 0; pair < 4; ++pair) {
    result += foldedProduct(sums[pair * 2] ^ secretAt(11 + pair * 16), sums[pair * 2 + 1] ^ secretAt(19 + pair * 16));
  }
  return avalanche(result);
}

}  // namespace

std::uint64_t xxh3Hash64(ByteSpan bytes) {
  if (bytes.size <= 16) {
    return hashUpTo16(bytes.data, bytes.size);
  }
  return bytes.size <= 240 ? hashUpTo240(bytes.data, bytes.size) : hashLong(bytes.data, bytes.size);
}

}  // namespace terraport
