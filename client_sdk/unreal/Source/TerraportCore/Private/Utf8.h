#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace terraport {

/// Whether these bytes are UTF-8: shortest forms only, no surrogates, nothing beyond U+10FFFF.
bool isUtf8(std::string_view text);

/// Code points of a text. Of a text that is no UTF-8: bytes that begin one.
std::size_t codePointCount(std::string_view text);

/// Append one code point; a lone surrogate becomes three bytes that `isUtf8` refuses.
void appendCodePoint(unsigned long codePoint, std::string& into);

}  // namespace terraport
