#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <string>

#include "LittleEndian.h"
#include "SegmentFormat.h"
#include "Terraport/GlbDecoder.h"
#include "Terraport/Json.h"
#include "counting_new.h"
#include "mesh_arrays.h"
#include "test_files.h"

using namespace terraport;
using namespace terraport_tests;

namespace {

std::vector<std::filesystem::path> corpus() {
  std::vector<std::filesystem::path> paths;
  for (const auto& entry : std::filesystem::directory_iterator(conformance() / "scene" / "payload")) {
    if (entry.path().extension() != ".json") {
      paths.push_back(entry.path());
    }
  }
  std::sort(paths.begin(), paths.end());
  return paths;
}

/// The scene's attributes, as the case of a segment gives them.
std::vector<AttributeInfo> attributesOf(JsonValue expected) {
  std::vector<AttributeInfo> attributes;
  for (const JsonValue scale : expected.member("scales").items()) {
    AttributeInfo& attribute = attributes.emplace_back();
    attribute.name = scale.member("name").text().value_or("");
    attribute.offset = scale.member("offset").number().value_or(0.0);
    attribute.step = scale.member("step").number().value_or(0.0);
  }
  return attributes;
}

Status decode(const std::filesystem::path& path, JsonValue expected, SegmentMesh& mesh) {
  const std::vector<std::uint8_t> bytes = readFile(path);
  // Exactly as large as the payload, so that a sanitizer sees a byte too many.
  std::vector<std::uint8_t> exact(bytes.begin(), bytes.end());
  exact.shrink_to_fit();
  if (path.extension() == ".tsg") {
    SegmentDecoder decoder;
    return decoder.decode(viewOf(exact), attributesOf(expected), 7, mesh);
  }
  GlbDecoder decoder;
  return decoder.decode(viewOf(exact), mesh);
}

/// Compare rows of numbers with lists of lists (or a flat list), null for NaN.
template <typename T>
void compareRows(JsonValue expected, const std::vector<T>& rows, std::size_t width, std::size_t stride, double within) {
  REQUIRE(expected.isList());
  REQUIRE(rows.size() == expected.size() * stride);
  std::size_t row = 0;
  for (const JsonValue item : expected.items()) {
    std::size_t column = 0;
    const auto compare = [&](JsonValue value) {
      const double got = static_cast<double>(rows[row * stride + column]);
      CAPTURE(row);
      if (value.isNothing()) {
        CHECK(std::isnan(got));
      } else {
        CHECK(std::fabs(got - value.number().value_or(1e300)) <= within);
      }
      ++column;
    };
    if (item.isList()) {
      for (const JsonValue value : item.items()) {
        compare(value);
      }
    } else {
      compare(item);
    }
    CHECK(column == width);
    ++row;
  }
}

void compareMesh(JsonValue expected, const SegmentMesh& mesh) {
  const MeshArrays arrays = arraysOf(mesh);
  compareRows(expected.member("positions"), arrays.positions, 3, 3, 0.0);
  compareRows(expected.member("faces"), arrays.indices, 3, 3, 0.0);
  compareRows(expected.member("normals"), arrays.normals, 3, 3, 1e-6);
  CHECK(mesh.hasColours == !expected.member("colours").isNothing());
  if (!expected.member("colours").isNothing()) {
    compareRows(expected.member("colours"), arrays.colours, 3, 4, 0.0);
  }
  CHECK(mesh.hasRegionIds == !expected.member("region_ids").isNothing());
  if (mesh.hasRegionIds) {
    compareRows(expected.member("region_ids"), arrays.regionIds, 1, 1, 0.0);
  }
  CHECK(mesh.hasUvs == !expected.member("uvs").isNothing());
  if (mesh.hasUvs) {
    compareRows(expected.member("uvs"), arrays.uvs, 2, 2, 1e-6);
    const JsonValue texture = expected.member("texture");
    CHECK(texture.member("media_type").text().value_or("") == mediaTypeOf(mesh.image.type));
    CHECK(texture.member("width").integer().value_or(-1) == mesh.image.width);
    CHECK(texture.member("height").integer().value_or(-1) == mesh.image.height);
    CHECK(static_cast<std::size_t>(texture.member("gpu_bytes").integer().value_or(-1)) == mesh.image.gpuBytes());
  }
  const JsonValue attributes = expected.member("attributes");
  CHECK(attributes.size() == mesh.attributeCount);
  const JsonValue::Range members = attributes.items();
  for (JsonValue::Iterator at = members.begin(); at != members.end(); ++at) {
    const auto column = arrays.attributes.find(std::string(at.key()));
    REQUIRE(column != arrays.attributes.end());
    compareRows(*at, column->second, 1, 1, 1e-6);
  }
}

}  // namespace

TEST_SUITE("payload corpus") {
  TEST_CASE("every file is decoded to what it must, or refused") {
    int good = 0;
    int bad = 0;
    for (const std::filesystem::path& path : corpus()) {
      CAPTURE(path.filename().string());
      const std::string text = readText(path.string() + ".json");
      JsonDocument document;
      REQUIRE(document.read(text).isOk());
      SegmentMesh mesh;
      const Status status = decode(path, document.root(), mesh);
      const bool isGood = document.root().member("good").boolean().value_or(false);
      if (isGood) {
        ++good;
        REQUIRE_MESSAGE(status.isOk(), status.text());
        compareMesh(document.root(), mesh);
      } else {
        ++bad;
        CHECK_FALSE(status.isOk());
        CHECK(status.message().size() > 10);
        CHECK(mesh.vertexCount == 0);
      }
    }
    CHECK(good == 25);
    CHECK(bad == 47);
  }

  TEST_CASE("a payload that is cut short anywhere is refused") {
    for (const char* name : {"good-full.glb", "good-jpeg.glb", "good-base.glb"}) {
      const std::vector<std::uint8_t> whole = readFile(conformance() / "scene" / "payload" / name);
      SegmentMesh mesh;
      GlbDecoder glb;
      for (std::size_t size = 0; size < whole.size(); ++size) {
        const std::vector<std::uint8_t> cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
        const Status status = glb.decode(viewOf(cut), mesh);
        CHECK_FALSE(status.isOk());
      }
    }
    for (const char* name : {"good-attributes.tsg", "good-jpeg.tsg"}) {
      const std::vector<std::uint8_t> whole = readFile(conformance() / "scene" / "payload" / name);
      const std::vector<AttributeInfo> attributes(2);
      SegmentMesh mesh;
      SegmentDecoder decoder;
      for (std::size_t size = 0; size < whole.size(); ++size) {
        const std::vector<std::uint8_t> cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
        CHECK_FALSE(decoder.decode(viewOf(cut), attributes, 0, mesh).isOk());
      }
      CHECK(decoder.decode(viewOf(whole), attributes, 0, mesh).isOk());
    }
  }

  TEST_CASE("a few bytes that claim a large stream make no large buffer") {
    std::vector<std::uint8_t> payload = readFile(conformance() / "scene" / "payload" / "good-plain.tsg");
    const std::uint32_t packed = readU32(&payload[4]);
    SegmentMesh mesh;
    SegmentDecoder decoder;
    for (const std::uint32_t claimed : {packed * 1100, (1U << 28) + 1, 0xFFFFFFFFU}) {
      for (std::size_t byte = 0; byte < 4; ++byte) {
        payload[12 + packed - 4 + byte] = static_cast<std::uint8_t>(claimed >> (8 * byte));
      }
      const std::size_t before = allocatedBytes();
      CHECK_FALSE(decoder.decode(viewOf(payload), {}, 0, mesh).isOk());
      CHECK(allocatedBytes() - before < 4096);
    }
  }
}
