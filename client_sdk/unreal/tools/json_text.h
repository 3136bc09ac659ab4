#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace terraport::tools {

/// Writes one JSON text, comma by comma.
class JsonText {
 public:
  JsonText& open(char bracket);
  JsonText& close(char bracket);
  JsonText& key(std::string_view name);
  JsonText& null();
  JsonText& boolean(bool value);
  JsonText& integer(std::int64_t value);
  /// All digits that a double has; null where it is not finite.
  JsonText& number(double value);
  JsonText& text(std::string_view value);
  JsonText& integers(const std::vector<std::uint32_t>& values);
  JsonText& numbers(const std::vector<float>& values);

  const std::string& str() const { return text_; }

 private:
  JsonText& raw(std::string_view written);

  std::string text_;
  bool needsComma_ = false;
};

}  // namespace terraport::tools
