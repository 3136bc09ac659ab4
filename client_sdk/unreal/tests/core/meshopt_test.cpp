#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "Meshopt.h"
#include "test_files.h"

using namespace terraport;
using namespace terraport_tests;

namespace {

/// A stream of one block with rows of 4 bytes whose first channel has the given group, and the others none.
std::vector<std::uint8_t> streamOfChannel(std::uint8_t header, const std::vector<std::uint8_t>& group) {
  // Behind the group: headers of three channels of zeros, and the tail.
  std::vector<std::uint8_t> stream(2 + group.size() + 3 + 32, 0);
  stream[0] = kMeshoptVertexCodec;
  stream[1] = header;
  std::copy(group.begin(), group.end(), stream.begin() + 2);
  return stream;
}

}  // namespace

TEST_SUITE("meshopt") {
  TEST_CASE("the specification's example of 4-bit differences") {
    const std::vector<std::uint8_t> group = {0x17, 0x5f, 0xf0, 0xbc, 0x77, 0xa9, 0x21, 0x00, 0x34, 0xb5};
    const std::vector<std::uint8_t> stream = streamOfChannel(2, group);
    std::vector<std::uint8_t> rows(64);
    REQUIRE(meshoptDecodeVertices(viewOf(stream), 16, 4, rows.data()));
    const int differences[] = {-1, -4, -3, 26, -91, 0, -6, 6, -4, -4, 5, -5, 1, -1, 0, 0};
    std::uint8_t sum = 0;
    for (std::size_t row = 0; row < 16; ++row) {
      sum = static_cast<std::uint8_t>(sum + differences[row]);
      CHECK(rows[row * 4] == sum);
      CHECK(rows[row * 4 + 1] == 0);
    }
  }

  TEST_CASE("2-bit differences with bytes of their own") {
    // 1, 2, own, 0; then zeros; the own one is 200.
    const std::vector<std::uint8_t> stream = streamOfChannel(1, {0x6c, 0, 0, 0, 200});
    std::vector<std::uint8_t> rows(64);
    REQUIRE(meshoptDecodeVertices(viewOf(stream), 16, 4, rows.data()));
    CHECK(rows[0] == 255);
    CHECK(rows[4] == 0);
    CHECK(rows[8] == 100);
    CHECK(rows[60] == 100);
  }

  TEST_CASE("streams that are too short or too long are refused, and nothing beyond them is read") {
    const std::vector<std::uint8_t> group = {0x17, 0x5f, 0xf0, 0xbc, 0x77, 0xa9, 0x21, 0x00, 0x34, 0xb5};
    const std::vector<std::uint8_t> whole = streamOfChannel(2, group);
    std::vector<std::uint8_t> rows(65 * 4);
    for (std::size_t size = 0; size < whole.size(); ++size) {
      std::vector<std::uint8_t> cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
      cut.shrink_to_fit();
      CHECK_FALSE(meshoptDecodeVertices(viewOf(cut), 16, 4, rows.data()));
    }
    std::vector<std::uint8_t> longer = whole;
    longer.push_back(0);
    CHECK_FALSE(meshoptDecodeVertices(viewOf(longer), 16, 4, rows.data()));
    CHECK_FALSE(meshoptDecodeVertices(viewOf(whole), 65, 4, rows.data()));
    CHECK_FALSE(meshoptDecodeVertices(viewOf(whole), 4, 20, rows.data()));
  }

  TEST_CASE("triangles: new vertices, edges and explicit ones") {
    // f0 with the table's first entry 0: three new vertices; 00: the newest edge and a new one; ff: explicit.
    std::vector<std::uint8_t> stream = {kMeshoptIndexCodec, 0xf0, 0x00, 0xff};
    stream.insert(stream.end(), {0xff, 20, 2, 3});  // kinds: all explicit; 20, 2, 3 are zigzag steps of +10, +1, -2
    stream.insert(stream.end(), 16, 0);
    std::vector<std::uint32_t> indices(9);
    REQUIRE(meshoptDecodeTriangles(viewOf(stream), 9, indices.data()));
    CHECK(indices == std::vector<std::uint32_t>{0, 1, 2, 0, 2, 3, 10, 11, 9});
    for (std::size_t size = 0; size < stream.size(); ++size) {
      std::vector<std::uint8_t> cut(stream.begin(), stream.begin() + static_cast<std::ptrdiff_t>(size));
      cut.shrink_to_fit();
      CHECK_FALSE(meshoptDecodeTriangles(viewOf(cut), 9, indices.data()));
    }
  }

  TEST_CASE("what was never seen is no vertex") {
    std::vector<std::uint8_t> stream = {kMeshoptIndexCodec, 0x31};
    stream.insert(stream.end(), 16, 0);
    std::vector<std::uint32_t> indices(3);
    REQUIRE(meshoptDecodeTriangles(viewOf(stream), 3, indices.data()));
    CHECK(indices == std::vector<std::uint32_t>(3, 0xFFFFFFFFU));
  }

  TEST_CASE("the octahedral filter gives the specification's formula for every code") {
    for (int bits = 4; bits <= 8; ++bits) {
      const int unit = (1 << (bits - 1)) - 1;
      int wrong = 0;
      for (int x = -unit; x <= unit; ++x) {
        for (int y = -unit; y <= unit; ++y) {
          std::uint8_t row[4] = {
              static_cast<std::uint8_t>(x), static_cast<std::uint8_t>(y), static_cast<std::uint8_t>(unit), 77};
          meshoptUnfilterOctahedral(row, 1);
          double vector[3] = {static_cast<double>(x), static_cast<double>(y), 0.0};
          vector[2] = unit - std::fabs(vector[0]) - std::fabs(vector[1]);
          const double fold = std::fmin(vector[2], 0.0);
          vector[0] += x >= 0 ? fold : -fold;
          vector[1] += y >= 0 ? fold : -fold;
          const double length = std::sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]);
          for (int axis = 0; axis < 3; ++axis) {
            wrong += static_cast<std::int8_t>(row[axis]) == std::lround(vector[axis] / length * 127.0) ? 0 : 1;
          }
          CHECK(row[3] == 77);
        }
      }
      CHECK(wrong == 0);
    }
    std::uint8_t none[4] = {0, 0, 0, 5};
    meshoptUnfilterOctahedral(none, 1);
    CHECK((none[0] | none[1] | none[2]) == 0);
  }

  TEST_CASE("the exponential filter") {
    const auto decoded = [](std::int32_t exponent, std::int32_t mantissa) {
      const std::uint32_t bits =
          (static_cast<std::uint32_t>(exponent) << 24) | (static_cast<std::uint32_t>(mantissa) & 0xFFFFFFU);
      std::uint8_t word[4];
      std::memcpy(word, &bits, 4);
      meshoptUnfilterExponential(word, 1);
      float value = 0.0F;
      std::memcpy(&value, word, 4);
      return value;
    };
    CHECK(decoded(0, 5) == 5.0F);
    CHECK(decoded(-3, 5) == 0.625F);
    CHECK(decoded(-12, -4097) == -4097.0F / 4096.0F);
    CHECK(decoded(100, -1) == -std::ldexp(1.0F, 100));
    CHECK(decoded(-100, 0x7FFFFF) == std::ldexp(8388607.0F, -100));
  }
}
