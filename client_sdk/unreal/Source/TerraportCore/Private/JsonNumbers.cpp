// Decimal numbers to doubles and back, without the C library's locale and, in reading, exactly.
#include "Terraport/Json.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>

namespace terraport {

namespace {

/// More digits than decide between two doubles; of what follows only whether it is 0 matters.
constexpr std::size_t kMostDigits = 800;
constexpr std::uint64_t kMostExact = std::uint64_t{1} << 53;
/// Exponents beyond give infinity or 0, whatever the digits.
constexpr long kFarExponent = 100000;

/// A natural number up to 2^8192: the largest that comes up here has 5100 bits (801 digits, 5^400 and 2^1475; or 5^1201 and
/// 2^2171). In memory of its own: reading a number allocates nothing.
class Natural {
 public:
  explicit Natural(std::uint64_t value) {
    for (; value != 0; value >>= 32) push(static_cast<std::uint32_t>(value));
  }

  void multiplyAdd(std::uint32_t factor, std::uint32_t addend) {
    std::uint64_t carry = addend;
    for (std::size_t at = 0; at < size_; ++at) {
      carry += static_cast<std::uint64_t>(words_[at]) * factor;
      words_[at] = static_cast<std::uint32_t>(carry);
      carry >>= 32;
    }
    if (carry != 0) push(static_cast<std::uint32_t>(carry));
  }

  void multiplyByPowerOf5(long power) {
    constexpr std::uint32_t k5To13 = 1220703125;
    for (; power >= 13; power -= 13) multiplyAdd(k5To13, 0);
    for (; power > 0; --power) multiplyAdd(5, 0);
  }

  void shiftLeft(long bits) {
    if (size_ == 0 || bits <= 0) return;
    const auto wordShift = static_cast<std::size_t>(bits / 32);
    const auto bitShift = static_cast<unsigned>(bits % 32);
    if (bitShift != 0) {
      std::uint32_t carry = 0;
      for (std::size_t at = 0; at < size_; ++at) {
        const std::uint32_t shifted = (words_[at] << bitShift) | carry;
        carry = words_[at] >> (32 - bitShift);
        words_[at] = shifted;
      }
      if (carry != 0) push(carry);
    }
    if (wordShift > kWords - size_) return;  // beyond the bound: it does not come up
    std::memmove(words_ + wordShift, words_, size_ * sizeof words_[0]);
    std::memset(words_, 0, wordShift * sizeof words_[0]);
    size_ += wordShift;
  }

  /// Below 0, 0, or above it, as this is below, equal to, above the other.
  int compareTo(const Natural& other) const {
    if (size_ != other.size_) return size_ < other.size_ ? -1 : 1;
    for (std::size_t at = size_; at > 0; --at) {
      if (words_[at - 1] != other.words_[at - 1]) return words_[at - 1] < other.words_[at - 1] ? -1 : 1;
    }
    return 0;
  }

 private:
  static constexpr std::size_t kWords = 256;

  void push(std::uint32_t word) {
    if (size_ < kWords) words_[size_++] = word;
  }

  /// Least significant first, the last not 0.
  std::uint32_t words_[kWords];
  std::size_t size_ = 0;
};

/// Up to kMostDigits digits, and one more that says that some follow.
class Digits {
 public:
  bool empty() const { return size_ == 0; }
  std::size_t size() const { return size_; }
  char back() const { return digits_[size_ - 1]; }
  void push_back(char digit) { digits_[size_++] = digit; }
  void pop_back() { --size_; }
  char operator[](std::size_t at) const { return digits_[at]; }
  const char* begin() const { return digits_; }
  const char* end() const { return digits_ + size_; }

 private:
  char digits_[kMostDigits + 1];
  std::size_t size_ = 0;
};

/// Significant digits, and the power of ten behind the last of them.
struct Decimal {
  bool isNegative = false;
  Digits digits;
  long exponent = 0;
};

/// `text` is a number by JSON's grammar, which the reader has checked.
///
/// Invariant: what was read so far is `digits` * 10^`exponent`, but for digits beyond kMostDigits. Of those it only counts
/// whether one is not 0: a 1 behind the others puts the number on the right side of every halfway point.
Decimal split(std::string_view text) {
  // 1. The sign.
  Decimal decimal;
  std::size_t at = 0;
  if (at < text.size() && text[at] == '-') {
    decimal.isNegative = true;
    ++at;
  }
  // 2. Digits, without leading zeros; the point only moves the exponent.
  bool isFraction = false;
  bool hasMore = false;
  for (; at < text.size() && text[at] != 'e' && text[at] != 'E'; ++at) {
    const char letter = text[at];
    if (letter == '.') {
      isFraction = true;
      continue;
    }
    if (decimal.digits.empty() && letter == '0') {
      decimal.exponent -= isFraction ? 1 : 0;
    } else if (decimal.digits.size() < kMostDigits) {
      decimal.digits.push_back(letter);
      decimal.exponent -= isFraction ? 1 : 0;
    } else {
      hasMore = hasMore || letter != '0';
      decimal.exponent += isFraction ? 0 : 1;
    }
  }
  if (hasMore) {
    decimal.digits.push_back('1');
    decimal.exponent -= 1;
  }
  // 3. The stated exponent, cut off far beyond what a double can have, so that it cannot overflow.
  if (at < text.size()) {
    ++at;
    const bool isDown = at < text.size() && text[at] == '-';
    if (at < text.size() && (text[at] == '-' || text[at] == '+')) ++at;
    long exponent = 0;
    for (; at < text.size(); ++at) exponent = std::min(10 * exponent + (text[at] - '0'), 100 * kFarExponent);
    decimal.exponent += isDown ? -exponent : exponent;
  }
  // 4. Trailing zeros go: fewer digits to multiply by.
  while (!decimal.digits.empty() && decimal.digits.back() == '0') {
    decimal.digits.pop_back();
    decimal.exponent += 1;
  }
  return decimal;
}

/// Powers of ten that are exact as doubles.
double smallPowerOf10(long power) {
  static const double powers[] = {1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16,
      1e17, 1e18, 1e19, 1e20, 1e21, 1e22};
  return powers[power];
}

/// The decimal number against halfway from `low` to the next double above it.
int compareToHalfway(const Decimal& decimal, double low) {
  int binaryExponent = 0;
  const double fraction = std::frexp(low, &binaryExponent);
  // Subnormal numbers have their last bit where the smallest normal one has it.
  long lastBit = std::max(static_cast<long>(binaryExponent) - 53, -1074L);
  auto mantissa = static_cast<std::uint64_t>(std::ldexp(fraction, static_cast<int>(binaryExponent - lastBit)));
  if (low == 0) {
    mantissa = 0;
    lastBit = -1074;
  }
  Natural scaledDigits(0);
  for (const char digit : decimal.digits) {
    if (scaledDigits.compareTo(Natural(0)) == 0) {
      scaledDigits = Natural(static_cast<std::uint64_t>(digit - '0'));
    } else {
      scaledDigits.multiplyAdd(10, static_cast<std::uint32_t>(digit - '0'));
    }
  }
  Natural halfway(2 * mantissa + 1);
  // scaledDigits * 10^e against halfway * 2^(lastBit - 1), without negative powers.
  const long twos = decimal.exponent - (lastBit - 1);
  if (decimal.exponent >= 0) {
    scaledDigits.multiplyByPowerOf5(decimal.exponent);
  } else {
    halfway.multiplyByPowerOf5(-decimal.exponent);
  }
  if (twos >= 0) {
    scaledDigits.shiftLeft(twos);
  } else {
    halfway.shiftLeft(-twos);
  }
  return scaledDigits.compareTo(halfway);
}

bool isEven(double value) {
  std::uint64_t bits = 0;
  std::memcpy(&bits, &value, sizeof bits);
  return (bits & 1) == 0;
}

/// A double some units in the last place from the number.
double roughly(const Decimal& decimal) {
  double value = 0;
  const std::size_t digitCount = std::min<std::size_t>(decimal.digits.size(), 17);
  for (std::size_t at = 0; at < digitCount; ++at) value = 10 * value + (decimal.digits[at] - '0');
  long power = decimal.exponent + static_cast<long>(decimal.digits.size() - digitCount);
  // In steps, so that neither the power nor the product leaves the range too early.
  for (; power > 22; power -= 22) value *= 1e22;
  for (; power < -22; power += 22) value /= 1e22;
  return power >= 0 ? value * smallPowerOf10(power) : value / smallPowerOf10(-power);
}

double nearest(const Decimal& decimal) {
  constexpr double kMost = std::numeric_limits<double>::max();
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  double value = std::min(roughly(decimal), kMost);
  for (;;) {
    const int above = compareToHalfway(decimal, value);
    if (above < 0 || (above == 0 && isEven(value))) break;
    if (value == kMost) return kInfinity;
    value = std::nextafter(value, kInfinity);
    if (above == 0) return value;
  }
  while (value > 0) {
    const double below = std::nextafter(value, 0.0);
    const int above = compareToHalfway(decimal, below);
    if (above > 0 || (above == 0 && isEven(value))) break;
    value = below;
  }
  return value;
}

}  // namespace

double readDecimal(std::string_view text) {
  const Decimal decimal = split(text);
  double value = 0;
  const long size = static_cast<long>(decimal.digits.size()) + decimal.exponent;
  if (decimal.digits.empty() || size < -400) {
    value = 0;
  } else if (size > 400) {
    value = std::numeric_limits<double>::infinity();
  } else {
    std::uint64_t mantissa = 0;
    const bool isShort = decimal.digits.size() <= 16;
    if (isShort) {
      for (const char digit : decimal.digits) mantissa = 10 * mantissa + static_cast<std::uint64_t>(digit - '0');
    }
    if (isShort && mantissa <= kMostExact && decimal.exponent >= -22 && decimal.exponent <= 22) {
      // Both are exact, so that one division or product is rounded once.
      value = static_cast<double>(mantissa);
      value = decimal.exponent >= 0 ? value * smallPowerOf10(decimal.exponent) : value / smallPowerOf10(-decimal.exponent);
    } else {
      value = nearest(decimal);
    }
  }
  return decimal.isNegative ? -value : value;
}

}  // namespace terraport
