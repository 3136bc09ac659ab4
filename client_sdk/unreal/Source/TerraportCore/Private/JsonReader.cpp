#include "Terraport/Json.h"
#include "Utf8.h"

#include <algorithm>

namespace terraport {

namespace {

/// The longest integer that the Python side reads.
constexpr std::size_t kLongestInteger = 4300;
constexpr std::int64_t kLargestInteger = (std::int64_t{1} << 53) - 1;
/// Beyond it the reader's own recursion would need too much of a small stack.
constexpr std::uint32_t kDeepest = 256;
constexpr std::uint32_t kNoValue = 0xFFFFFFFF;

bool isDigit(char letter) {
  return letter >= '0' && letter <= '9';
}

int jsonHexDigit(char letter) {
  if (isDigit(letter)) return letter - '0';
  if (letter >= 'a' && letter <= 'f') return letter - 'a' + 10;
  if (letter >= 'A' && letter <= 'F') return letter - 'A' + 10;
  return -1;
}

}  // namespace

/// One reading of one text.
class JsonReader {
 public:
  JsonReader(JsonDocument& document, std::string_view text, const JsonLimits& limits)
      : document_(document), text_(text), limits_(limits), maxDepth_(std::min(limits.maxDepth, kDeepest)) {}

  Status read() {
    if (!value(0)) return status();
    skipBlank();
    if (at_ != text_.size()) return fail("got something after the value, expected the end"), status();
    return Status::ok();
  }

 private:
  using Node = JsonDocument::Node;

  Status status() const { return Status::failed("malformed", error_, static_cast<std::int64_t>(at_)); }

  bool fail(const char* text) {
    if (error_.empty()) error_ = text;
    return false;
  }

  bool unexpected(const char* expected) {
    if (!error_.empty()) return false;
    error_ = "got ";
    if (at_ >= text_.size()) {
      error_ += "the end";
    } else {
      error_ += "byte " + std::to_string(static_cast<unsigned char>(text_[at_]));
    }
    error_ += std::string(", expected ") + expected;
    return false;
  }

  char peek() const { return at_ < text_.size() ? text_[at_] : '\0'; }

  void skipBlank() {
    while (at_ < text_.size()) {
      const char letter = text_[at_];
      if (letter != ' ' && letter != '\t' && letter != '\n' && letter != '\r') return;
      ++at_;
    }
  }

  /// Step over a character if it is the next one that is no blank.
  bool next(char letter) {
    skipBlank();
    if (at_ >= text_.size() || text_[at_] != letter) return false;
    ++at_;
    return true;
  }

  /// A new value at the end; kNoValue beyond the bound.
  std::uint32_t add(JsonKind kind) {
    if (document_.nodes_.size() >= limits_.maxValues) {
      fail("got too many values");
      return kNoValue;
    }
    Node node;
    node.kind = kind;
    node.after = static_cast<std::uint32_t>(document_.nodes_.size()) + 1;
    document_.nodes_.push_back(node);
    return node.after - 1;
  }

  bool value(std::uint32_t depth) {
    skipBlank();
    if (at_ >= text_.size()) return unexpected("a value");
    switch (text_[at_]) {
      case '{':
        return map(depth + 1);
      case '[':
        return list(depth + 1);
      case '"':
        return string();
      case 't':
        return word("true", JsonKind::Boolean, JsonDocument::kTrue);
      case 'f':
        return word("false", JsonKind::Boolean, 0);
      case 'n':
        return word("null", JsonKind::Null, 0);
      default:
        return number();
    }
  }

  bool word(std::string_view name, JsonKind kind, std::uint8_t flags) {
    if (text_.substr(at_, name.size()) != name) return unexpected("a value");
    const std::uint32_t index = add(kind);
    if (index == kNoValue) return false;
    document_.nodes_[index].flags = flags;
    at_ += name.size();
    return true;
  }

  bool digits() {
    if (!isDigit(peek())) return unexpected("a number of JSON");
    while (isDigit(peek())) ++at_;
    return true;
  }

  bool number() {
    const std::size_t start = at_;
    if (peek() == '-') {
      ++at_;
    } else if (!isDigit(peek())) {
      return unexpected("a value");
    }
    if (peek() == '0') {
      ++at_;
    } else if (!digits()) {
      return false;
    }
    bool isWhole = true;
    if (peek() == '.') {
      isWhole = false;
      ++at_;
      if (!digits()) return false;
    }
    if (peek() == 'e' || peek() == 'E') {
      isWhole = false;
      ++at_;
      if (peek() == '+' || peek() == '-') ++at_;
      if (!digits()) return false;
    }
    const std::uint32_t index = add(isWhole ? JsonKind::Integer : JsonKind::Float);
    if (index == kNoValue) return false;
    Node& node = document_.nodes_[index];
    node.offset = static_cast<std::uint32_t>(start);
    node.length = static_cast<std::uint32_t>(at_ - start);
    if (isWhole && node.length > kLongestInteger) return fail("got a number that is too long");
    if (!isWhole || !readWhole(text_.substr(start, node.length), node.whole)) node.flags = JsonDocument::kUnread;
    return true;
  }

  /// The integer, where it is exact as a double.
  static bool readWhole(std::string_view text, std::int64_t& whole) {
    const bool isNegative = text.front() == '-';
    std::int64_t value = 0;
    for (const char letter : text.substr(isNegative ? 1 : 0)) {
      value = 10 * value + (letter - '0');
      if (value > kLargestInteger) return false;
    }
    whole = isNegative ? -value : value;
    return true;
  }

  bool map(std::uint32_t depth) {
    const std::uint32_t index = enter(JsonKind::Map, depth);
    if (index == kNoValue) return false;
    std::uint32_t count = 0;
    if (!next('}')) {
      for (;;) {
        skipBlank();
        if (peek() != '"') return unexpected("a key in quotes");
        if (!string()) return false;
        if (!next(':')) return unexpected("a colon");
        if (!value(depth)) return false;
        ++count;
        if (next('}')) break;
        if (!next(',')) return unexpected("a comma or }");
      }
    }
    leave(index, count);
    return !document_.hasKeyTwice(index) || fail("got a key twice, expected each key once");
  }

  bool list(std::uint32_t depth) {
    const std::uint32_t index = enter(JsonKind::List, depth);
    if (index == kNoValue) return false;
    std::uint32_t count = 0;
    if (!next(']')) {
      for (;;) {
        if (!value(depth)) return false;
        ++count;
        if (next(']')) break;
        if (!next(',')) return unexpected("a comma or ]");
      }
    }
    leave(index, count);
    return true;
  }

  std::uint32_t enter(JsonKind kind, std::uint32_t depth) {
    if (depth > maxDepth_) {
      fail("got nesting beyond the limit");
      return kNoValue;
    }
    ++at_;
    return add(kind);
  }

  void leave(std::uint32_t index, std::uint32_t count) {
    document_.nodes_[index].length = count;
    document_.nodes_[index].after = static_cast<std::uint32_t>(document_.nodes_.size());
  }

  bool string() {
    const std::uint32_t index = add(JsonKind::Text);
    if (index == kNoValue) return false;
    ++at_;
    const std::size_t start = at_;
    skipRun();
    if (peek() == '"') {
      document_.nodes_[index].offset = static_cast<std::uint32_t>(start);
      document_.nodes_[index].length = static_cast<std::uint32_t>(at_ - start);
      ++at_;
      return true;
    }
    const std::size_t decodedStart = document_.decoded_.size();
    document_.decoded_.append(text_.substr(start, at_ - start));
    while (peek() != '"') {
      if (peek() != '\\') return unexpected("the end of a text");
      if (!escape()) return false;
      const std::size_t run = at_;
      skipRun();
      document_.decoded_.append(text_.substr(run, at_ - run));
    }
    ++at_;
    Node& node = document_.nodes_[index];
    node.flags = JsonDocument::kDecoded;
    node.offset = static_cast<std::uint32_t>(decodedStart);
    node.length = static_cast<std::uint32_t>(document_.decoded_.size() - decodedStart);
    return true;
  }

  /// Go on to a quote, a backslash, a control character or the end.
  void skipRun() {
    while (at_ < text_.size()) {
      const auto letter = static_cast<unsigned char>(text_[at_]);
      if (letter < 0x20 || letter == '"' || letter == '\\') return;
      ++at_;
    }
  }

  bool escape() {
    ++at_;
    std::string& into = document_.decoded_;
    const char letter = peek();
    ++at_;
    switch (letter) {
      case '"':
      case '\\':
      case '/':
        into.push_back(letter);
        return true;
      case 'b':
        into.push_back('\b');
        return true;
      case 'f':
        into.push_back('\f');
        return true;
      case 'n':
        into.push_back('\n');
        return true;
      case 'r':
        into.push_back('\r');
        return true;
      case 't':
        into.push_back('\t');
        return true;
      case 'u':
        return unicodeEscape();
      default:
        --at_;
        return unexpected("an escape of JSON");
    }
  }

  bool unicodeEscape() {
    unsigned long unit = 0;
    if (!hex4(unit)) return unexpected("four hexadecimal digits");
    if (unit >= 0xD800 && unit <= 0xDBFF && text_.substr(at_, 2) == "\\u") {
      const std::size_t before = at_;
      at_ += 2;
      unsigned long low = 0;
      if (!hex4(low)) return unexpected("four hexadecimal digits");
      if (low >= 0xDC00 && low <= 0xDFFF) {
        appendCodePoint(0x10000 + ((unit - 0xD800) << 10) + (low - 0xDC00), document_.decoded_);
        return true;
      }
      at_ = before;
    }
    if (unit >= 0xD800 && unit <= 0xDFFF) return fail("got a lone surrogate");
    appendCodePoint(unit, document_.decoded_);
    return true;
  }

  bool hex4(unsigned long& unit) {
    unit = 0;
    for (int number = 0; number < 4; ++number) {
      const int digit = jsonHexDigit(peek());
      if (digit < 0) return false;
      unit = 16 * unit + static_cast<unsigned long>(digit);
      ++at_;
    }
    return true;
  }

  JsonDocument& document_;
  const std::string_view text_;
  const JsonLimits& limits_;
  const std::uint32_t maxDepth_;
  std::size_t at_ = 0;
  std::string error_;
};

Status JsonDocument::read(std::string_view text, const JsonLimits& limits) {
  clear();
  // Places in the text are 32-bit numbers.
  const std::size_t maxBytes = std::min<std::size_t>(limits.maxBytes, 0x7FFFFFFF);
  if (text.size() > maxBytes) {
    return Status::failed(
        "malformed", "got JSON of " + std::to_string(text.size()) + " bytes, expected at most " + std::to_string(maxBytes));
  }
  if (!isUtf8(text)) return Status::failed("malformed", "got text that is not UTF-8");
  source_ = text;
  const Status status = JsonReader(*this, text, limits).read();
  if (!status.isOk()) clear();
  return status;
}

}  // namespace terraport
