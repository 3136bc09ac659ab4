// Bits and Huffman codes of BasisLZ (KTX 2.0, "BasisLZ Huffman Tables").
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "Core/Basics.h"

namespace terraport {

/// Bits of a file, the lowest of a byte first. Beyond the end there are zeros, and it is not good any more.
class BasisBits {
 public:
  explicit BasisBits(ByteSpan bytes) : bytes_(bytes) {}
  bool isGood() const { return isGood_; }
  void spoil() { isGood_ = false; }

  /// At most 16.
  std::uint32_t take(std::uint32_t count);
  /// In pieces of so many bits, the lowest first, each followed by a bit that says whether another one comes.
  std::uint32_t takeVariable(std::uint32_t bits);

 private:
  ByteSpan bytes_;
  std::size_t next_ = 0;
  std::uint64_t buffer_ = 0;
  std::uint32_t held_ = 0;
  bool isGood_ = true;
};

/// A canonical Huffman code of at most 16 bits.
class HuffmanTable {
 public:
  /// False where what was read is no code. One without symbols is fine until it is decoded by.
  bool read(BasisBits& bits);
  /// The next symbol; 0 where the bits are those of none, which spoils them.
  std::uint32_t decode(BasisBits& bits) const;

 private:
  static constexpr std::size_t kMostBits = 16;
  bool build(const std::vector<std::uint8_t>& lengths);

  /// By length: how many codes, and of those of that length the first code and where its symbol stands.
  std::array<std::uint32_t, kMostBits + 1> counts_{};
  std::array<std::uint32_t, kMostBits + 1> firstCodes_{};
  std::array<std::uint32_t, kMostBits + 1> firstPlaces_{};
  std::vector<std::uint16_t> symbols_;
};

}  // namespace terraport
