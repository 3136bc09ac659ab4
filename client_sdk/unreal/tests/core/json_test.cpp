// The JSON reader by itself: strictness, bounds, numbers.
#include "Terraport/Json.h"
#include "stream_toy.h"

#include <doctest/doctest.h>

#include <clocale>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <string>

using namespace terraport;
using namespace terraport::testing;

namespace {

bool isRead(const std::string& text, const JsonLimits& limits = {}) {
  JsonDocument document;
  const Status status = document.read(text, limits);
  CHECK(document.root().exists() == status.isOk());
  if (!status.isOk()) CHECK(status.code() == "malformed");
  return status.isOk();
}

}  // namespace

TEST_CASE("json: values are read as what they are") {
  const std::string text = R"( {"a": [1, -2.5, true, false, null, "x"], "b": {"c": 12345678901234567890}, "d": ""} )";
  JsonDocument document;
  REQUIRE(document.read(text).isOk());
  const JsonValue root = document.root();
  REQUIRE(root.isMap());
  CHECK(root.size() == 3);
  const JsonValue list = root.member("a");
  REQUIRE(list.isList());
  CHECK(list.size() == 6);
  auto item = list.items().begin();
  CHECK(*(*item).integer() == 1);
  CHECK(*(*item).number() == 1);
  ++item;
  CHECK(*(*item).number() == -2.5);
  CHECK(!(*item).integer().has_value());
  ++item;
  CHECK(*(*item).boolean());
  ++item;
  CHECK(!*(*item).boolean());
  ++item;
  CHECK((*item).exists());
  CHECK((*item).isNothing());
  ++item;
  CHECK(*(*item).text() == "x");
  const JsonValue large = root.member("b").member("c");
  CHECK(large.kind() == JsonKind::Integer);
  CHECK(!large.integer().has_value());
  CHECK(*large.number() == 12345678901234567890.0);
  CHECK(root.member("d").text()->empty());
  CHECK(!root.member("e").exists());
  CHECK(!root.member("e").member("f").number().has_value());
  std::string keys;
  for (auto member = root.items().begin(); member != root.items().end(); ++member) keys += member.key();
  CHECK(keys == "abd");
  CHECK(!list.text().has_value());
  CHECK(!list.binary().has_value());
}

TEST_CASE("json: what is no JSON is refused") {
  for (const char* const text :
      {"", " ", "{", "}", "[1,]", "[,1]", "{\"a\":1,}", "{\"a\" 1}", "{a:1}", "'a'", "01", "1.", ".5", "+1", "-", "1e", "1e+",
          "0x1", "NaN", "Infinity", "-Infinity", "tru", "nul", "\"", "\"\\x\"", "\"\\u12g4\"", "\"\\u123", "\"\\ud800\"",
          "\"\\udc00x\"", "\"\\ud800\\u0041\"", "\"a\nb\"", "[1] 2", "{} x", "// a\n1", "{\"a\":1,\"a\":2}", "\xEF\xBB\xBF{}",
          "\"\xff\"", "\"\xc0\x80\"", "\"\xed\xa0\x80\"", "\"\xf4\x90\x80\x80\"", "\"\xe2\x82\""}) {
    CAPTURE(text);
    CHECK(!isRead(text));
  }
  CHECK(!isRead(std::string("\"\0\"", 3)));
}

TEST_CASE("json: escapes become the characters that they stand for") {
  JsonDocument document;
  const std::string text = R"({"A":"\"\\\/\b\f\n\r\t\u00e9\u20AC\ud83d\ude00", "plain": "é"})";
  REQUIRE(document.read(text).isOk());
  CHECK(*document.root().member("A").text() == "\"\\/\b\f\n\r\t\xC3\xA9\xE2\x82\xAC\xF0\x9F\x98\x80");
  CHECK(*document.root().member("plain").text() == "\xC3\xA9");
  // The same key, once with an escape.
  CHECK(!isRead(R"({"a":1,"\u0061":2})"));
}

TEST_CASE("json: every bound is kept") {
  JsonLimits limits;
  limits.maxDepth = 3;
  CHECK(isRead("[[[1]]]", limits));
  CHECK(!isRead("[[[[1]]]]", limits));
  limits.maxDepth = 1000000;
  CHECK(isRead(std::string(200, '[') + std::string(200, ']'), limits));
  // Whatever is asked for, the stack is not exhausted.
  CHECK(!isRead(std::string(1000000, '['), limits));
  CHECK(!isRead(std::string(1000000, '[') + std::string(1000000, ']'), limits));
  limits = {};
  limits.maxValues = 4;
  CHECK(isRead("[1,2,3]", limits));
  CHECK(!isRead("[1,2,3,4]", limits));
  CHECK(!isRead("{\"a\":1,\"b\":2}", limits));
  limits = {};
  limits.maxBytes = 4;
  CHECK(isRead("[12]", limits));
  CHECK(!isRead("[123]", limits));
  CHECK(!isRead(std::string(4301, '9')));
  CHECK(isRead(std::string(4300, '9')));
}

TEST_CASE("json: a map of very many keys is searched for repeats in less than quadratic time") {
  std::string text = "{";
  for (int number = 0; number < 200000; ++number) text += "\"" + std::to_string(number) + "\":0,";
  CHECK(isRead(text + "\"x\":0}"));
  CHECK(!isRead(text + "\"777\":0}"));
}

TEST_CASE("json: a document can be read anew, and after a failure") {
  JsonDocument document;
  const std::string first = "[1,2,3]";
  const std::string second = "{\"a\":\"\\n\"}";
  REQUIRE(document.read(first).isOk());
  CHECK(!document.read("[").isOk());
  CHECK(!document.root().exists());
  REQUIRE(document.read(second).isOk());
  CHECK(*document.root().member("a").text() == "\n");
}

TEST_CASE("json: numbers are read as the C library reads them, to the last bit") {
  for (const char* const text :
      {"0", "-0", "0.0", "1", "0.1", "123456789012345678", "9007199254740993", "9007199254740992.99999999999999999",
          "9007199254740993.00000000000000001", "1e22", "1e23", "8.5e22", "1.7976931348623157e308", "1.7976931348623159e308",
          "1.7976931348623158e308", "1e309", "1e99999999999", "4.9e-324", "2.5e-324", "2.4703282292062327e-324",
          "2.4703282292062328e-324", "2.2250738585072014e-308", "2.2250738585072011e-308", "1e-400", "1e-99999999999", "0e5",
          "0.000000000000000000000000000000000000000000000000000000000000001", "5e-324", "1.00000000000000011102230246251565",
          "1.00000000000000011102230246251566", "6929495644600919.5", "3.2378839133029012895883524125015321748630094238e-319",
          "100000000000000000000000000000000000000000000000000000000000000000000000000000"}) {
    CAPTURE(text);
    const double expected = std::strtod(text, nullptr);
    const double got = readDecimal(text);
    CHECK(std::memcmp(&got, &expected, sizeof got) == 0);
  }
  // More digits than are kept decide too.
  const std::string halfway = "9007199254740993" + std::string(".") + std::string(1000, '0');
  CHECK(readDecimal(halfway) == 9007199254740992.0);
  CHECK(readDecimal(halfway + "1") == 9007199254740994.0);
}

TEST_CASE("json: any number is read back to the last bit from seventeen digits") {
  Seeded random(7);
  for (int count = 0; count < 20000; ++count) {
    std::uint64_t bits = 0;
    for (int quarter = 0; quarter < 4; ++quarter) bits = (bits << 16) | static_cast<std::uint64_t>(random.below(65536));
    double value = 0;
    std::memcpy(&value, &bits, sizeof value);
    if (!std::isfinite(value)) continue;
    char text[40];
    std::snprintf(text, sizeof text, "%.17g", value);
    const double again = readDecimal(text);
    CHECK(std::memcmp(&again, &value, sizeof value) == 0);
  }
}

TEST_CASE("json: a locale with a comma changes nothing") {
  const std::string before = std::setlocale(LC_NUMERIC, nullptr);
  for (const char* const name : {"de_DE.UTF-8", "de_DE", "C.UTF-8"}) {
    if (std::setlocale(LC_NUMERIC, name) == nullptr) continue;
    CHECK(readDecimal("0.5") == 0.5);
  }
  std::setlocale(LC_NUMERIC, before.c_str());
}
