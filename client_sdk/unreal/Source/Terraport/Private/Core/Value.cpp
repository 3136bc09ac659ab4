#include "Core/Value.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <locale>
#include <sstream>

namespace terraport {
namespace {

constexpr int kMaxDepth = 16;
/// Of a map or list of msgpack.
constexpr std::uint64_t kMaxItems = 16384;

bool isContinuation(char byte) {
  return (static_cast<unsigned char>(byte) & 0xC0) == 0x80;
}

bool areKeysDistinct(const Value& map) {
  std::vector<std::string_view> keys;
  keys.reserve(map.members.size());
  for (const auto& [key, value] : map.members) {
    (void)value;
    keys.emplace_back(key);
  }
  std::sort(keys.begin(), keys.end());
  return std::adjacent_find(keys.begin(), keys.end()) == keys.end();
}

/// Reads msgpack (https://github.com/msgpack/msgpack/blob/master/spec.md) without extensions.
class MsgpackReader {
 public:
  explicit MsgpackReader(ByteSpan bytes) : bytes_(bytes) {}

  Status read(Value& out) {
    readValue(out, 0);
    if (problem_.empty() && at_ != bytes_.size) problem_ = "bytes after the value";
    if (problem_.empty()) return {};
    return Status::damaged("msgpack at byte " + std::to_string(at_) + ": got " + problem_ + ", expected one whole value");
  }

 private:
  using Kind = Value::Kind;

  std::uint64_t take(std::size_t count) {
    if (count > bytes_.size - at_) {
      fail("the end of the message");
      return 0;
    }
    std::uint64_t number = 0;
    for (std::size_t byte = 0; byte < count; ++byte) number = (number << 8) | bytes_.data[at_ + byte];
    at_ += count;
    return number;
  }

  void fail(const char* problem) {
    if (problem_.empty()) problem_ = problem;
  }

  void readValue(Value& out, int depth) {
    const auto token = static_cast<unsigned>(take(1));
    if (!problem_.empty()) return;
    if (token <= 0x7f || token >= 0xe0) {
      setInteger(out, token <= 0x7f ? static_cast<std::int64_t>(token) : static_cast<std::int64_t>(token) - 256);
    } else if (token <= 0x8f) {
      readMap(out, token & 15, depth);
    } else if (token <= 0x9f) {
      readList(out, token & 15, depth);
    } else if (token <= 0xbf) {
      readBytes(out, Kind::Text, token & 31);
    } else {
      readLong(out, token, depth);
    }
  }

  void readLong(Value& out, unsigned token, int depth) {
    switch (token) {
      case 0xc0:
        out.kind = Kind::Nil;
        return;
      case 0xc2:
      case 0xc3:
        out.kind = Kind::Boolean;
        out.boolean = token == 0xc3;
        return;
      case 0xc4:
      case 0xc5:
      case 0xc6:
        readBytes(out, Kind::Binary, take(std::size_t{1} << (token - 0xc4)));
        return;
      case 0xca: {
        const auto bits = static_cast<std::uint32_t>(take(4));
        float number = 0.0F;
        std::memcpy(&number, &bits, sizeof number);
        setNumber(out, number);
        return;
      }
      case 0xcb: {
        const std::uint64_t bits = take(8);
        double number = 0.0;
        std::memcpy(&number, &bits, sizeof number);
        setNumber(out, number);
        return;
      }
      case 0xcc:
      case 0xcd:
      case 0xce:
      case 0xcf: {
        const std::uint64_t number = take(std::size_t{1} << (token - 0xcc));
        const bool fits = number <= static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max());
        fits ? setInteger(out, static_cast<std::int64_t>(number)) : setNumber(out, static_cast<double>(number));
        return;
      }
      case 0xd0:
        setInteger(out, static_cast<std::int8_t>(take(1)));
        return;
      case 0xd1:
        setInteger(out, static_cast<std::int16_t>(take(2)));
        return;
      case 0xd2:
        setInteger(out, static_cast<std::int32_t>(take(4)));
        return;
      case 0xd3:
        setInteger(out, static_cast<std::int64_t>(take(8)));
        return;
      case 0xd9:
      case 0xda:
      case 0xdb:
        readBytes(out, Kind::Text, take(std::size_t{1} << (token - 0xd9)));
        return;
      case 0xdc:
        readList(out, take(2), depth);
        return;
      case 0xdd:
        readList(out, take(4), depth);
        return;
      case 0xde:
        readMap(out, take(2), depth);
        return;
      case 0xdf:
        readMap(out, take(4), depth);
        return;
      default:
        fail("an extension or an unused token");
        return;
    }
  }

  static void setInteger(Value& out, std::int64_t number) {
    out.kind = Kind::Integer;
    out.integer = number;
  }

  static void setNumber(Value& out, double number) {
    out.kind = Kind::Number;
    out.number = number;
  }

  void readBytes(Value& out, Kind kind, std::uint64_t count) {
    if (count > bytes_.size - at_) return fail("the end of the message");
    out.kind = kind;
    out.text.assign(reinterpret_cast<const char*>(bytes_.data) + at_, static_cast<std::size_t>(count));
    at_ += static_cast<std::size_t>(count);
    if (kind == Kind::Text && !isUtf8(out.text)) fail("text that is not UTF-8");
  }

  /// Whether a map or list of so many items can follow: each takes some bytes, so a false count is noticed at once.
  bool canFollow(std::uint64_t count, std::uint64_t leastBytes, int depth) {
    if (depth >= kMaxDepth) fail("too many levels");
    if (count > kMaxItems) fail("a map or list of more than 16,384 items");
    if (count * leastBytes > bytes_.size - at_) fail("the end of the message");
    return problem_.empty();
  }

  void readList(Value& out, std::uint64_t count, int depth) {
    out.kind = Kind::List;
    if (!canFollow(count, 1, depth)) return;
    for (; count > 0 && problem_.empty(); --count) readValue(out.items.emplace_back(), depth + 1);
  }

  void readMap(Value& out, std::uint64_t count, int depth) {
    out.kind = Kind::Map;
    if (!canFollow(count, 2, depth)) return;
    for (; count > 0 && problem_.empty(); --count) {
      Value key;
      readValue(key, depth + 1);
      if (key.kind != Kind::Text) return fail("a key that is not text");
      out.members.emplace_back(std::move(key.text), Value());
      readValue(out.members.back().second, depth + 1);
    }
    if (!areKeysDistinct(out)) fail("a key that stands twice");
  }

  ByteSpan bytes_;
  std::size_t at_ = 0;
  std::string problem_;
};

class JsonReader {
 public:
  explicit JsonReader(std::string_view text) : text_(text) {}

  Status read(Value& out) {
    readValue(out, 0);
    skipSpace();
    if (isGood_ && at_ == text_.size()) return {};
    return Status::damaged("JSON is not valid at byte " + std::to_string(at_));
  }

 private:
  using Kind = Value::Kind;

  char next() const { return at_ < text_.size() ? text_[at_] : '\0'; }

  void skipSpace() {
    while (next() == ' ' || next() == '\n' || next() == '\r' || next() == '\t') ++at_;
  }

  bool take(std::string_view literal) {
    const bool isThere = text_.substr(at_, literal.size()) == literal;
    at_ += isThere ? literal.size() : 0;
    return isThere;
  }

  void readValue(Value& out, int depth) {
    skipSpace();
    if (depth > kMaxDepth) {
      isGood_ = false;
    } else if (take("{")) {
      readMap(out, depth);
    } else if (take("[")) {
      readList(out, depth);
    } else if (next() == '"') {
      out.kind = Kind::Text;
      readText(out.text);
    } else if (take("true") || take("false")) {
      out.kind = Kind::Boolean;
      out.boolean = text_[at_ - 2] == 'u';
    } else if (take("null")) {
      out.kind = Kind::Nil;
    } else {
      readNumber(out);
    }
  }

  void readMap(Value& out, int depth) {
    out.kind = Kind::Map;
    skipSpace();
    if (take("}")) return;
    do {
      skipSpace();
      std::string key;
      readText(key);
      skipSpace();
      isGood_ = isGood_ && take(":");
      if (!isGood_) return;
      out.members.emplace_back(std::move(key), Value());
      readValue(out.members.back().second, depth + 1);
      skipSpace();
    } while (isGood_ && take(","));
    isGood_ = isGood_ && take("}") && areKeysDistinct(out);
  }

  void readList(Value& out, int depth) {
    out.kind = Kind::List;
    skipSpace();
    if (take("]")) return;
    do {
      readValue(out.items.emplace_back(), depth + 1);
      skipSpace();
    } while (isGood_ && take(","));
    isGood_ = isGood_ && take("]");
  }

  void readText(std::string& out) {
    isGood_ = isGood_ && take("\"");
    while (isGood_ && next() != '"') {
      const char letter = next();
      ++at_;
      if (static_cast<unsigned char>(letter) < 0x20) {
        isGood_ = false;
      } else if (letter != '\\') {
        out.push_back(letter);
      } else {
        readEscape(out);
      }
    }
    isGood_ = isGood_ && take("\"") && isUtf8(out);
  }

  void readEscape(std::string& out) {
    constexpr std::string_view kLetters = "\"\\/bfnrt", kMeanings = "\"\\/\b\f\n\r\t";
    const char letter = next();
    ++at_;
    if (letter == 'u') {
      std::uint32_t code = readHex();
      if (code >= 0xD800 && code < 0xDC00 && take("\\u")) code = 0x10000 + ((code - 0xD800) << 10) + (readHex() - 0xDC00);
      appendUtf8(code, out);
    } else if (const std::size_t known = kLetters.find(letter); known != std::string_view::npos) {
      out.push_back(kMeanings[known]);
    } else {
      isGood_ = false;
    }
  }

  std::uint32_t readHex() {
    std::uint32_t code = 0;
    for (int digit = 0; digit < 4; ++digit, ++at_) {
      const std::size_t value = std::string_view("0123456789abcdefABCDEF").find(next());
      isGood_ = isGood_ && value != std::string_view::npos;
      code = 16 * code + static_cast<std::uint32_t>(value < 16 ? value : value - 6);
    }
    return code;
  }

  /// Lone halves of a pair come out as bytes that `isUtf8` refuses.
  static void appendUtf8(std::uint32_t code, std::string& out) {
    if (code < 0x80) {
      out.push_back(static_cast<char>(code));
      return;
    }
    const int more = code < 0x800 ? 1 : code < 0x10000 ? 2 : 3;
    out.push_back(static_cast<char>((0xF0 << (3 - more)) | (code >> (6 * more))));
    for (int at = more; at-- > 0;) out.push_back(static_cast<char>(0x80 | ((code >> (6 * at)) & 0x3F)));
  }

  void readNumber(Value& out) {
    const std::size_t start = at_;
    while (next() != '\0' && std::string_view("+-0123456789.eE").find(next()) != std::string_view::npos) ++at_;
    const std::string digits(text_.substr(start, at_ - start));
    // A stream with the classic locale: strtod would follow the program's, and from_chars is not on every platform.
    std::istringstream stream(digits);
    stream.imbue(std::locale::classic());
    stream >> out.number;
    const std::size_t first = digits.find_first_not_of('-');
    isGood_ = isGood_ && stream && stream.peek() == std::char_traits<char>::eof() && first != std::string::npos &&
        digits[first] >= '0' && digits[first] <= '9';
    const bool isWhole = digits.find_first_of(".eE") == std::string::npos && std::fabs(out.number) < 9e15;
    out.kind = isWhole ? Kind::Integer : Kind::Number;
    out.integer = isWhole ? static_cast<std::int64_t>(out.number) : 0;
  }

  std::string_view text_;
  std::size_t at_ = 0;
  bool isGood_ = true;
};

}  // namespace

bool isUtf8(std::string_view text) {
  for (std::size_t at = 0; at < text.size();) {
    const auto first = static_cast<unsigned char>(text[at]);
    const auto second = static_cast<unsigned char>(at + 1 < text.size() ? text[at + 1] : '\0');
    std::size_t length = 1;
    if (first >= 0x80) {
      length = first >= 0xC2 && first <= 0xDF ? 2 : first >= 0xE0 && first <= 0xEF ? 3 : first >= 0xF0 && first <= 0xF4 ? 4 : 0;
      // Neither overlong forms nor surrogates nor code points beyond U+10FFFF.
      const bool isBad = (first == 0xE0 && second < 0xA0) || (first == 0xED && second >= 0xA0) ||
          (first == 0xF0 && second < 0x90) || (first == 0xF4 && second >= 0x90);
      if (length == 0 || isBad || length > text.size() - at) return false;
    }
    for (std::size_t more = 1; more < length; ++more) {
      if (!isContinuation(text[at + more])) return false;
    }
    at += length;
  }
  return true;
}

const Value& Value::operator[](std::string_view key) const {
  static const Value kAbsent;
  for (const auto& [name, value] : members) {
    if (name == key) return value;
  }
  return kAbsent;
}

std::optional<std::int64_t> Value::integerIn(std::int64_t low, std::int64_t high) const {
  if (kind != Kind::Integer || integer < low || integer > high) return std::nullopt;
  return integer;
}

std::optional<double> Value::numberIn(double low, double high) const {
  const double value = kind == Kind::Integer ? static_cast<double>(integer) : number;
  if ((kind != Kind::Integer && kind != Kind::Number) || !(value >= low && value <= high)) return std::nullopt;
  return value;
}

std::optional<std::string> Value::textUpTo(std::size_t mostCodePoints) const {
  const auto count = text.size() - static_cast<std::size_t>(std::count_if(text.begin(), text.end(), isContinuation));
  if (kind != Kind::Text || count > mostCodePoints) return std::nullopt;
  return text;
}

std::optional<bool> Value::flag() const {
  return kind == Kind::Boolean ? std::optional<bool>(boolean) : std::nullopt;
}

std::optional<Vec3> Value::point(double mostM) const {
  if (kind != Kind::List || items.size() != 3) return std::nullopt;
  const auto x = items[0].numberIn(-mostM, mostM), y = items[1].numberIn(-mostM, mostM), z = items[2].numberIn(-mostM, mostM);
  return x && y && z ? std::optional<Vec3>(Vec3{*x, *y, *z}) : std::nullopt;
}

Status readMsgpack(ByteSpan bytes, Value& out) {
  out = Value();
  return MsgpackReader(bytes).read(out);
}

Status readJson(ByteSpan bytes, Value& out) {
  out = Value();
  return JsonReader({reinterpret_cast<const char*>(bytes.data), bytes.size}).read(out);
}

void MsgpackWriter::text(std::string_view text) {
  if (text.size() < 32) {
    out_.push_back(static_cast<std::uint8_t>(0xa0 | text.size()));
  } else {
    out_.push_back(0xda);
    bigEndian(text.size(), 2);
  }
  out_.insert(out_.end(), text.begin(), text.end());
}

void MsgpackWriter::binary(ByteSpan bytes) {
  out_.push_back(0xc6);
  bigEndian(bytes.size, 4);
  out_.insert(out_.end(), bytes.data, bytes.data + bytes.size);
}

void MsgpackWriter::integer(std::uint64_t number) {
  if (number < 0x80) {
    out_.push_back(static_cast<std::uint8_t>(number));
  } else {
    out_.push_back(0xcf);
    bigEndian(number, 8);
  }
}

void MsgpackWriter::number(double number) {
  std::uint64_t bits = 0;
  std::memcpy(&bits, &number, sizeof bits);
  out_.push_back(0xcb);
  bigEndian(bits, 8);
}

void MsgpackWriter::head(unsigned fixed, std::size_t fixedCount, unsigned token16, std::size_t count) {
  if (count < fixedCount) {
    out_.push_back(static_cast<std::uint8_t>(fixed | count));
  } else {
    out_.push_back(static_cast<std::uint8_t>(token16));
    bigEndian(count, 2);
  }
}

void MsgpackWriter::bigEndian(std::uint64_t number, int bytes) {
  for (int byte = bytes; byte-- > 0;) out_.push_back(static_cast<std::uint8_t>(number >> (8 * byte)));
}

}  // namespace terraport
