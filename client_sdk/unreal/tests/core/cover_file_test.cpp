// The corpus of covers: good ones give what is written beside them, bad ones are refused.
#include <doctest/doctest.h>

#include "Terraport/CoverFile.h"
#include "Terraport/Json.h"
#include "Terraport/Xxh3.h"
#include "test_files.h"

using namespace terraport;
using namespace terraport_tests;

namespace {

std::uint32_t wholeOf(JsonValue value) {
  return static_cast<std::uint32_t>(value.number().value_or(0));
}

std::vector<std::uint32_t> wholesOf(JsonValue list) {
  std::vector<std::uint32_t> numbers;
  for (const JsonValue item : list.items()) {
    numbers.push_back(wholeOf(item));
  }
  return numbers;
}

void seal(std::vector<std::uint8_t>& file) {
  const std::uint64_t check = xxh3Hash64({file.data() + 16, file.size() - 16});
  for (std::size_t byte = 0; byte < 8; ++byte) {
    file[8 + byte] = static_cast<std::uint8_t>(check >> (8 * byte));
  }
}

}  // namespace

TEST_SUITE("covers") {
  TEST_CASE("covers of the corpus are read, or refused") {
    int good = 0;
    int bad = 0;
    for (const auto& entry : std::filesystem::directory_iterator(conformance() / "scene" / "cover")) {
      if (entry.path().extension() != ".cover") {
        continue;
      }
      CAPTURE(entry.path().filename().string());
      // Exactly as large as the file, so that a sanitizer sees a byte too many.
      std::vector<std::uint8_t> file = readFile(entry.path());
      file.shrink_to_fit();
      const std::string text = readText(std::filesystem::path(entry.path()).replace_extension(".json"));
      JsonDocument document;
      REQUIRE(document.read(text).isOk());
      const JsonValue expected = document.root();
      const std::uint32_t faces = wholeOf(expected.member("base_faces"));
      const std::uint32_t segments = wholeOf(expected.member("segment_count"));
      Cover cover;
      const Status status = decodeCover(viewOf(file), faces, segments, cover);
      if (expected.member("error").text()) {
        CHECK_FALSE(status.isOk());
        ++bad;
        continue;
      }
      CHECK_MESSAGE(status.isOk(), status.text());
      CHECK(cover.offsets == wholesOf(expected.member("offsets")));
      CHECK(cover.segments == wholesOf(expected.member("segments")));
      CHECK(checkCover(cover, segments).isOk());
      if (!cover.segments.empty()) {
        CHECK_FALSE(decodeCover(viewOf(file), faces, segments - 1, cover).isOk());
      }
      ++good;
    }
    CHECK(good >= 9);
    CHECK(bad >= 21);
  }

  TEST_CASE("a flipped bit is noticed; under a right checksum the cover is read or refused") {
    const std::vector<std::uint8_t> whole = readFile(conformance() / "scene" / "cover" / "good-many.cover");
    int accepted = 0;
    for (std::size_t bit = 0; bit < 8 * whole.size(); ++bit) {
      std::vector<std::uint8_t> changed = whole;
      changed[bit / 8] ^= static_cast<std::uint8_t>(1U << (bit % 8));
      Cover cover;
      CHECK_FALSE(decodeCover(viewOf(changed), 12, 4096, cover).isOk());
      seal(changed);
      if (bit >= 8 * 32 && decodeCover(viewOf(changed), 12, 4096, cover).isOk()) {
        CHECK(checkCover(cover, 4096).isOk());
        ++accepted;
      }
    }
    CHECK(accepted > 10);
  }
}
