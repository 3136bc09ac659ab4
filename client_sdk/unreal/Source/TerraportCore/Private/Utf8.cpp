#include "Utf8.h"

namespace terraport {

namespace {

bool isTail(unsigned char byte) {
  return (byte & 0xC0) == 0x80;
}

}  // namespace

bool isUtf8(std::string_view text) {
  const auto* at = reinterpret_cast<const unsigned char*>(text.data());
  const auto* const end = at + text.size();
  while (at != end) {
    const unsigned char first = *at;
    const std::ptrdiff_t remaining = end - at;
    if (first < 0x80) {
      at += 1;
    } else if (first >= 0xC2 && first <= 0xDF) {
      if (remaining < 2 || !isTail(at[1])) return false;
      at += 2;
    } else if ((first & 0xF0) == 0xE0) {
      if (remaining < 3 || !isTail(at[1]) || !isTail(at[2])) return false;
      if (first == 0xE0 && at[1] < 0xA0) return false;
      if (first == 0xED && at[1] >= 0xA0) return false;
      at += 3;
    } else if (first >= 0xF0 && first <= 0xF4) {
      if (remaining < 4 || !isTail(at[1]) || !isTail(at[2]) || !isTail(at[3])) return false;
      if (first == 0xF0 && at[1] < 0x90) return false;
      if (first == 0xF4 && at[1] >= 0x90) return false;
      at += 4;
    } else {
      return false;
    }
  }
  return true;
}

std::size_t codePointCount(std::string_view text) {
  std::size_t count = 0;
  for (const char byte : text) count += isTail(static_cast<unsigned char>(byte)) ? 0 : 1;
  return count;
}

void appendCodePoint(unsigned long codePoint, std::string& into) {
  const auto append = [&into](unsigned long byte) { into.push_back(static_cast<char>(byte)); };
  if (codePoint < 0x80) {
    append(codePoint);
  } else if (codePoint < 0x800) {
    append(0xC0 | (codePoint >> 6));
    append(0x80 | (codePoint & 0x3F));
  } else if (codePoint < 0x10000) {
    append(0xE0 | (codePoint >> 12));
    append(0x80 | ((codePoint >> 6) & 0x3F));
    append(0x80 | (codePoint & 0x3F));
  } else {
    append(0xF0 | (codePoint >> 18));
    append(0x80 | ((codePoint >> 12) & 0x3F));
    append(0x80 | ((codePoint >> 6) & 0x3F));
    append(0x80 | (codePoint & 0x3F));
  }
}

}  // namespace terraport
