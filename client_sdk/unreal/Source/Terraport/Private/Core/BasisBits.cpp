#include "Core/BasisBits.h"

namespace terraport {
namespace {

constexpr std::uint32_t kLengthSymbols = 21;

/// In which order the lengths of the lengths' own code stand: runs first, then by how usual a length is.
constexpr std::uint8_t kLengthOrder[kLengthSymbols] = {
    17, 18, 19, 20, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15, 16};

}  // namespace

std::uint32_t BasisBits::take(std::uint32_t count) {
  while (held_ < count) {
    const bool isThere = next_ < bytes_.size;
    isGood_ = isGood_ && isThere;
    buffer_ |= std::uint64_t{isThere ? bytes_.data[next_] : std::uint8_t{0}} << held_;
    next_ += isThere ? 1 : 0;
    held_ += 8;
  }
  const auto taken = static_cast<std::uint32_t>(buffer_ & ((std::uint64_t{1} << count) - 1));
  buffer_ >>= count;
  held_ -= count;
  return taken;
}

std::uint32_t BasisBits::takeVariable(std::uint32_t bits) {
  std::uint32_t value = 0;
  for (std::uint32_t shift = 0; shift < 32; shift += bits) {
    const std::uint32_t piece = take(bits + 1);
    value |= (piece & ((1U << bits) - 1)) << shift;
    if ((piece >> bits) == 0) return value;
  }
  spoil();
  return 0;
}

bool HuffmanTable::read(BasisBits& bits) {
  symbols_.clear();
  counts_.fill(0);
  const std::uint32_t count = bits.take(14);
  if (count == 0) return bits.isGood();
  // 1. The code of the lengths.
  const std::uint32_t lengthCount = bits.take(5);
  if (lengthCount < 1 || lengthCount > kLengthSymbols) return false;
  std::vector<std::uint8_t> ownLengths(kLengthSymbols, 0);
  for (std::uint32_t at = 0; at < lengthCount; ++at) ownLengths[kLengthOrder[at]] = static_cast<std::uint8_t>(bits.take(3));
  HuffmanTable ofLengths;
  if (!ofLengths.build(ownLengths)) return false;
  // 2. The lengths: as they are, runs of 0, runs of the last one.
  std::vector<std::uint8_t> lengths;
  lengths.reserve(count);
  while (lengths.size() < count && bits.isGood()) {
    const std::uint32_t symbol = ofLengths.decode(bits);
    if (symbol <= 16) {
      lengths.push_back(static_cast<std::uint8_t>(symbol));
      continue;
    }
    const bool isOfZeros = symbol <= 18;
    if (!isOfZeros && lengths.empty()) return false;
    const std::uint32_t run = symbol == 17 ? bits.take(3) + 3
        : symbol == 18                     ? bits.take(7) + 11
        : symbol == 19                     ? bits.take(2) + 3
                                           : bits.take(7) + 7;
    if (run > count - lengths.size()) return false;
    lengths.insert(lengths.end(), run, isOfZeros ? std::uint8_t{0} : lengths.back());
  }
  return bits.isGood() && build(lengths);
}

bool HuffmanTable::build(const std::vector<std::uint8_t>& lengths) {
  counts_.fill(0);
  for (const std::uint8_t length : lengths) counts_[length] += length > 0 ? 1 : 0;
  std::uint32_t code = 0, place = 0;
  for (std::size_t length = 1; length <= kMostBits; ++length) {
    code <<= 1;
    firstCodes_[length] = code;
    firstPlaces_[length] = place;
    code += counts_[length];
    place += counts_[length];
    if (code > (1U << length)) {
      return false;  // more codes than there are
    }
  }
  symbols_.assign(place, 0);
  std::array<std::uint32_t, kMostBits + 1> next = firstPlaces_;
  for (std::size_t symbol = 0; symbol < lengths.size(); ++symbol) {
    if (lengths[symbol] > 0) symbols_[next[lengths[symbol]]++] = static_cast<std::uint16_t>(symbol);
  }
  return true;
}

std::uint32_t HuffmanTable::decode(BasisBits& bits) const {
  std::uint32_t code = 0;
  for (std::size_t length = 1; length <= kMostBits; ++length) {
    code = (code << 1) | bits.take(1);
    if (code - firstCodes_[length] < counts_[length] && code >= firstCodes_[length]) {
      return symbols_[firstPlaces_[length] + code - firstCodes_[length]];
    }
  }
  bits.spoil();
  return 0;
}

}  // namespace terraport
