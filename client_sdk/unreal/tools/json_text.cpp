#include "json_text.h"

#include <cmath>
#include <cstdio>

namespace terraport::tools {
namespace {

/// Append `text` with its quotes and escapes; `text` must be UTF-8.
void appendQuoted(std::string_view text, std::string& into) {
  into.push_back('"');
  for (const char letter : text) {
    switch (letter) {
      case '"':
        into.append("\\\"");
        break;
      case '\\':
        into.append("\\\\");
        break;
      case '\b':
        into.append("\\b");
        break;
      case '\f':
        into.append("\\f");
        break;
      case '\n':
        into.append("\\n");
        break;
      case '\r':
        into.append("\\r");
        break;
      case '\t':
        into.append("\\t");
        break;
      default:
        if (static_cast<unsigned char>(letter) < 0x20) {
          char escape[8];
          std::snprintf(escape, sizeof escape, "\\u%04x", static_cast<unsigned>(letter));
          into.append(escape);
        } else {
          into.push_back(letter);
        }
    }
  }
  into.push_back('"');
}

}  // namespace

JsonText& JsonText::open(char bracket) {
  raw(std::string_view(&bracket, 1));
  needsComma_ = false;
  return *this;
}

JsonText& JsonText::close(char bracket) {
  text_ += bracket;
  needsComma_ = true;
  return *this;
}

JsonText& JsonText::key(std::string_view name) {
  text(name);
  text_ += ':';
  needsComma_ = false;
  return *this;
}

JsonText& JsonText::null() {
  return raw("null");
}

JsonText& JsonText::boolean(bool value) {
  return raw(value ? "true" : "false");
}

JsonText& JsonText::integer(std::int64_t value) {
  return raw(std::to_string(value));
}

JsonText& JsonText::number(double value) {
  if (!std::isfinite(value)) {
    return null();
  }
  char digits[40];
  std::snprintf(digits, sizeof digits, "%.17g", value);
  return raw(digits);
}

JsonText& JsonText::text(std::string_view value) {
  std::string quoted;
  appendQuoted(value, quoted);
  return raw(quoted);
}

JsonText& JsonText::integers(const std::vector<std::uint32_t>& values) {
  open('[');
  for (const std::uint32_t value : values) {
    integer(value);
  }
  return close(']');
}

JsonText& JsonText::numbers(const std::vector<float>& values) {
  open('[');
  for (const float value : values) {
    number(static_cast<double>(value));
  }
  return close(']');
}

JsonText& JsonText::raw(std::string_view written) {
  if (needsComma_) {
    text_ += ',';
  }
  text_ += written;
  needsComma_ = true;
  return *this;
}

}  // namespace terraport::tools
