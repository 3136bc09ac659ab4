// JSON texts, as manifests and GLB chunks hold them. The first byte sets the bounds.
//
// Every value is visited; every number that is read is read again from seventeen of its digits.
#include "Terraport/Json.h"
#include "Utf8.h"

#include <cstdint>
#include <cstdio>
#include <cstdlib>

using namespace terraport;

namespace {

void expect(bool isTrue) {
  if (!isTrue) std::abort();
}

std::size_t visit(const JsonValue& value) {
  std::size_t count = 1;
  if (const auto number = value.number()) {
    char text[40];
    std::snprintf(text, sizeof text, "%.17g", *number);
    expect(readDecimal(text) == *number);
    const auto whole = value.integer();
    expect(!whole || static_cast<double>(*whole) == *number);
  }
  if (const auto text = value.text()) {
    expect(isUtf8(*text));
  }
  const JsonValue::Range items = value.items();
  std::uint32_t walked = 0;
  for (auto item = items.begin(); item != items.end(); ++item) {
    count += visit(*item);
    walked += 1;
    if (value.isMap() && walked < 8) expect(value.member(item.key()).kind() == (*item).kind());
  }
  expect(walked == value.size());
  return count;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  static JsonDocument document;
  JsonLimits limits;
  limits.maxDepth = 1 + (data[0] & 0x1F);
  limits.maxValues = (data[0] & 0x20) != 0 ? 16 : 4096;
  const std::string_view text(reinterpret_cast<const char*>(data) + 1, size - 1);
  if (document.read(text, limits).isOk()) {
    expect(visit(document.root()) <= limits.maxValues);
  } else {
    expect(!document.root().exists());
  }
  return 0;
}
