// Attributes of EXT_meshopt_compression (specification, appendix A, "Mode 0: attributes").
//
// A block of up to 256 rows is decoded in two steps: the differences of each byte of a row, channel by channel, into a buffer
// of 4 KiB; then all channels of four bytes together, summed up from row to row. Where the processor has SSE2 (every x86-64)
// both steps work on 16 differences at once.
#include <algorithm>
#include <cstring>

#include "LittleEndian.h"
#include "Meshopt.h"

#if defined(__SSE2__) || defined(_M_X64)
#define TERRAPORT_SSE2 1
#include <emmintrin.h>
#if defined(_MSC_VER) && !defined(__clang__)
#include <intrin.h>
#endif
#else
#define TERRAPORT_SSE2 0
#endif

namespace terraport {
namespace {

constexpr std::size_t kMaxStride = 16;
constexpr std::size_t kGroupRows = 16;
constexpr std::size_t kMaxBlockRows = 256;
constexpr std::size_t kVertexTailBytes = 32;
/// What a group takes at most: 8 bytes of 4-bit codes and 16 bytes of their own. The stream's tail is longer, so that a group
/// that starts before it never leads beyond the end.
constexpr std::size_t kMaxGroupBytes = 24;
static_assert(kMaxGroupBytes <= kVertexTailBytes, "groups are checked at their start alone");

#if TERRAPORT_SSE2

/// Number of the lowest bit that is set.
inline unsigned lowestBit(unsigned mask) {
#if defined(_MSC_VER) && !defined(__clang__)
  unsigned long number = 0;
  _BitScanForward(&number, mask);
  return static_cast<unsigned>(number);
#else
  return static_cast<unsigned>(__builtin_ctz(mask));
#endif
}

/// Codes of all ones stand for a byte of its own, stored behind the codes.
const std::uint8_t* replaceSentinels(__m128i codes, int sentinel, const std::uint8_t* extra, std::uint8_t* out) {
  unsigned mask = static_cast<unsigned>(_mm_movemask_epi8(_mm_cmpeq_epi8(codes, _mm_set1_epi8(static_cast<char>(sentinel)))));
  _mm_storeu_si128(reinterpret_cast<__m128i*>(out), codes);
  for (; mask != 0; mask &= mask - 1) {
    out[lowestBit(mask)] = *extra++;
  }
  return extra;
}

const std::uint8_t* decodeTwoBits(const std::uint8_t* data, std::uint8_t* out) {
  const __m128i packed = _mm_cvtsi32_si128(static_cast<int>(readU32(data)));
  const __m128i fours = _mm_unpacklo_epi8(_mm_srli_epi16(packed, 4), packed);
  const __m128i twos = _mm_unpacklo_epi8(_mm_srli_epi16(fours, 2), fours);
  return replaceSentinels(_mm_and_si128(twos, _mm_set1_epi8(3)), 3, data + 4, out);
}

const std::uint8_t* decodeFourBits(const std::uint8_t* data, std::uint8_t* out) {
  const __m128i packed = _mm_loadl_epi64(reinterpret_cast<const __m128i*>(data));
  const __m128i fours = _mm_unpacklo_epi8(_mm_srli_epi16(packed, 4), packed);
  return replaceSentinels(_mm_and_si128(fours, _mm_set1_epi8(15)), 15, data + 8, out);
}

#else

const std::uint8_t* decodeTwoBits(const std::uint8_t* data, std::uint8_t* out) {
  const std::uint8_t* extra = data + 4;
  for (std::size_t row = 0; row < kGroupRows; ++row) {
    const std::uint8_t code = (data[row / 4] >> (6 - 2 * (row % 4))) & 3;
    out[row] = code == 3 ? *extra++ : code;
  }
  return extra;
}

const std::uint8_t* decodeFourBits(const std::uint8_t* data, std::uint8_t* out) {
  const std::uint8_t* extra = data + 8;
  for (std::size_t row = 0; row < kGroupRows; ++row) {
    const std::uint8_t code = (data[row / 2] >> (4 - 4 * (row % 2))) & 15;
    out[row] = code == 15 ? *extra++ : code;
  }
  return extra;
}

#endif

/// One group of 16 differences, not yet un-zigzagged. `data` is more than kMaxGroupBytes before the end.
const std::uint8_t* decodeGroup(const std::uint8_t* data, unsigned bits, std::uint8_t* out) {
  switch (bits) {
    case 0:
      std::memset(out, 0, kGroupRows);
      return data;
    case 1:
      return decodeTwoBits(data, out);
    case 2:
      return decodeFourBits(data, out);
    default:
      std::memcpy(out, data, kGroupRows);
      return data + kGroupRows;
  }
}

/// All groups of one channel of a block. Null where the stream ends too early.
const std::uint8_t* decodeChannel(const std::uint8_t* data, const std::uint8_t* end, std::size_t groups, std::uint8_t* out) {
  const std::size_t headerBytes = (groups + 3) / 4;
  if (static_cast<std::size_t>(end - data) < headerBytes) {
    return nullptr;
  }
  const std::uint8_t* header = data;
  data += headerBytes;
  for (std::size_t group = 0; group < groups; ++group, out += kGroupRows) {
    if (static_cast<std::size_t>(end - data) < kMaxGroupBytes) {
      return nullptr;
    }
    data = decodeGroup(data, (header[group / 4] >> (group % 4 * 2)) & 3, out);
  }
  return data;
}

/// Sum up four channels of a block into bytes `at` to `at + 3` of its rows; `last` is the row before, and the last one
/// afterwards.
void sumRows(const std::uint8_t* differences, std::size_t rows, std::size_t stride, std::uint8_t* out, std::uint8_t* last) {
  const std::uint8_t* channels[4] = {
      differences, differences + kMaxBlockRows, differences + 2 * kMaxBlockRows, differences + 3 * kMaxBlockRows};
  std::uint32_t sum = readU32(last);
  std::size_t row = 0;
#if TERRAPORT_SSE2
  // 1. Sixteen rows at a time. `sums` has the last row's four bytes in each of its four lanes.
  __m128i sums = _mm_set1_epi32(static_cast<int>(sum));
  const __m128i lowBit = _mm_set1_epi8(1);
  const __m128i sevenBits = _mm_set1_epi8(127);
  for (; row + kGroupRows <= rows; row += kGroupRows) {
    // 1a. Zigzag codes to signed differences: (code >> 1) ^ -(code & 1).
    __m128i deltas[4];
    for (int channel = 0; channel < 4; ++channel) {
      const __m128i codes = _mm_loadu_si128(reinterpret_cast<const __m128i*>(channels[channel] + row));
      const __m128i signs = _mm_sub_epi8(_mm_setzero_si128(), _mm_and_si128(codes, lowBit));
      deltas[channel] = _mm_xor_si128(_mm_and_si128(_mm_srli_epi16(codes, 1), sevenBits), signs);
    }
    // 1b. From channels of 16 rows to rows of four channels, four rows a register.
    const __m128i lowAb = _mm_unpacklo_epi8(deltas[0], deltas[1]);
    const __m128i highAb = _mm_unpackhi_epi8(deltas[0], deltas[1]);
    const __m128i lowCd = _mm_unpacklo_epi8(deltas[2], deltas[3]);
    const __m128i highCd = _mm_unpackhi_epi8(deltas[2], deltas[3]);
    const __m128i fours[4] = {_mm_unpacklo_epi16(lowAb, lowCd), _mm_unpackhi_epi16(lowAb, lowCd),
        _mm_unpacklo_epi16(highAb, highCd), _mm_unpackhi_epi16(highAb, highCd)};
    // 1c. Running sums over the four rows of a register in two steps (to the row before, then to the second before), plus the
    // row before the register.
    for (int quarter = 0; quarter < 4; ++quarter) {
      __m128i four = fours[quarter];
      four = _mm_add_epi8(four, _mm_slli_si128(four, 4));
      four = _mm_add_epi8(four, _mm_slli_si128(four, 8));
      four = _mm_add_epi8(four, sums);
      sums = _mm_shuffle_epi32(four, 0xff);
      if (stride == 4) {
        _mm_storeu_si128(reinterpret_cast<__m128i*>(out), four);
        out += 16;
      } else {
        for (int lane = 0; lane < 4; ++lane, out += stride) {
          const int word = _mm_cvtsi128_si32(four);
          std::memcpy(out, &word, 4);
          four = _mm_srli_si128(four, 4);
        }
      }
    }
  }
  sum = static_cast<std::uint32_t>(_mm_cvtsi128_si32(sums));
#endif
  // 2. The rows that are left, or all of them: the same row by row.
  for (; row < rows; ++row, out += stride) {
    const std::uint32_t code = channels[0][row] | (std::uint32_t{channels[1][row]} << 8) |
        (std::uint32_t{channels[2][row]} << 16) | (std::uint32_t{channels[3][row]} << 24);
    // Four bytes at a time: halves and signs, then a sum that carries nothing from one byte into the next.
    const std::uint32_t signs = (code & 0x01010101U) * 0xFFU;
    const std::uint32_t difference = ((code >> 1) & 0x7F7F7F7FU) ^ signs;
    sum = ((sum & 0x7F7F7F7FU) + (difference & 0x7F7F7F7FU)) ^ ((sum ^ difference) & 0x80808080U);
    std::memcpy(out, &sum, 4);
  }
  std::memcpy(last, &sum, 4);
}

}  // namespace

bool meshoptDecodeVertices(ByteSpan packed, std::size_t count, std::size_t stride, std::uint8_t* rows) {
  if (stride < 4 || stride > kMaxStride || stride % 4 != 0 || packed.size < 1 + kVertexTailBytes ||
      packed.data[0] != kMeshoptVertexCodec) {
    return false;
  }
  const std::uint8_t* const end = packed.data + packed.size;
  const std::uint8_t* data = packed.data + 1;
  std::uint8_t last[kMaxStride];
  std::memcpy(last, end - stride, stride);
  std::uint8_t differences[kMaxStride * kMaxBlockRows];
  for (std::size_t first = 0; first < count; first += kMaxBlockRows) {
    const std::size_t blockRows = std::min(count - first, kMaxBlockRows);
    const std::size_t groups = (blockRows + kGroupRows - 1) / kGroupRows;
    for (std::size_t channel = 0; channel < stride; ++channel) {
      data = decodeChannel(data, end, groups, differences + channel * kMaxBlockRows);
      if (data == nullptr) {
        return false;
      }
    }
    for (std::size_t channel = 0; channel < stride; channel += 4) {
      sumRows(differences + channel * kMaxBlockRows, blockRows, stride, rows + first * stride + channel, last + channel);
    }
  }
  return static_cast<std::size_t>(end - data) == kVertexTailBytes;
}

}  // namespace terraport
