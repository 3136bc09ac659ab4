#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <string>

#include "Terraport/GlbDecoder.h"
#include "Terraport/Json.h"
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

Status decode(const std::filesystem::path& path, SegmentMesh& mesh) {
  const std::vector<std::uint8_t> bytes = readFile(path);
  // Exactly as large as the payload, so that a sanitizer sees a byte too many.
  std::vector<std::uint8_t> exact(bytes.begin(), bytes.end());
  exact.shrink_to_fit();
  // The base alone may have a larger image, and is recognised by its name.
  const std::int64_t segment = path.filename() == "good-base.glb" ? -1 : 7;
  GlbDecoder decoder;
  return decoder.decode(viewOf(exact), segment, mesh);
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
  CHECK((mesh.colourForm != ColourForm::None) == !expected.member("colours").isNothing());
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
      const Status status = decode(path, mesh);
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
    CHECK(good == 10);
    CHECK(bad == 18);
  }

  TEST_CASE("a payload that is cut short anywhere is refused") {
    for (const char* name : {"good-full.glb", "good-jpeg.glb", "good-base.glb"}) {
      const std::vector<std::uint8_t> whole = readFile(conformance() / "scene" / "payload" / name);
      SegmentMesh mesh;
      GlbDecoder glb;
      for (std::size_t size = 0; size < whole.size(); ++size) {
        const std::vector<std::uint8_t> cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
        const Status status = glb.decode(viewOf(cut), 0, mesh);
        CHECK_FALSE(status.isOk());
      }
    }
  }
}
