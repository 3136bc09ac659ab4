// regions.json as places to go to, and as pieces that a region is part of: the answers that the other clients give.
#include "Terraport/Places.h"
#include "Manifest.h"

#include <doctest/doctest.h>

#include <string>

namespace terraport {
namespace {

struct Read {
  explicit Read(const std::string& text, const std::string& labels = "") {
    const ByteSpan given = {reinterpret_cast<const std::uint8_t*>(labels.data()), labels.size()};
    CHECK(readRegions({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}, readLabels(given), regions, unions)
            .isOk());
  }
  std::vector<RegionFacts> regions;
  std::vector<RegionUnion> unions;
};

const std::string kRegions = R"("regions": [{"id": 0, "area_m2": 2, "label": "field"}, {"id": 1, "area_m2": 3},
  {"id": 2, "area_m2": 5, "label": "meadow"}, {"id": 3, "area_m2": 7}])";

std::string withUnions(const std::string& unions) {
  return "{" + kRegions + ", \"unions\": [" + unions + "]}";
}

}  // namespace

TEST_CASE("what a region is part of grows from cost to cost, and two unions at one cost are one answer") {
  const Read read(withUnions("[0, 1, 1.5], [2, 4, 2], [3, 5, 2]"));
  const auto pieces = coarserPieces(read.regions, read.unions, 1);
  REQUIRE(pieces.size() == 2);
  CHECK(pieces[0].cost == 1.5);
  CHECK(pieces[0].regions == std::vector<std::uint32_t>{0, 1});
  CHECK(pieces[0].areaM2 == 5.0);
  CHECK(pieces[0].label == "field");
  CHECK(pieces[1].regions == std::vector<std::uint32_t>{0, 1, 2, 3});
  CHECK(pieces[1].areaM2 == 17.0);
  CHECK(pieces[1].label == "meadow");
  CHECK(coarserPieces(read.regions, read.unions, 3).size() == 1);
  CHECK(coarserPieces(read.regions, read.unions, 4).empty());
  CHECK(coarserPieces(read.regions, {}, 1).empty());
}

TEST_CASE("unions end with the first that is not as it should be") {
  for (const char* bad :
      {"[0, 9, 2]", "[1, 0, 2]", "[0, 0, 2]", "[0, 1]", "[0, 1, \"2\"]", "null", "[0, 1, 2, 3]", "[-1, 1, 2]"}) {
    CAPTURE(bad);
    CHECK(Read(withUnions(std::string("[0, 1, 1.5], ") + bad + ", [2, 4, 2]")).unions.size() == 1);
  }
  CHECK(Read("{" + kRegions + "}").unions.empty());
  CHECK(Read("{" + kRegions + ", \"unions\": 7}").unions.empty());
}

TEST_CASE("named regions are places, by name, the largest of each first") {
  const Read read(R"({"regions": [
    {"id": 0, "stable_id": 4, "label": "Stockpile", "area_m2": 10, "centroid": [1, 2, 3]},
    {"id": 1, "stable_id": 5, "label": "ramp", "area_m2": 20, "centroid": [9, 9, 9],
     "place": {"position": [4, 5, 6], "heading_deg": 90, "radius_m": 25}},
    {"id": 2, "stable_id": 6, "label": "stockpile", "area_m2": 30, "centroid": [7, 8, 9]},
    {"id": 3, "stable_id": 7, "centroid": [0, 0, 0]},
    {"id": 4, "stable_id": 8, "label": "nowhere"},
    {"id": 5, "stable_id": 9, "label": "ramp", "centroid": [0, 1, 0], "place": {"position": [4, 5, 6], "radius_m": -1}}]})",
      R"({"format": "terraport-labels", "format_version": "1.0", "labels": [{"stable_id": 7, "label": "pit"}]})");
  const auto places = placesOf(read.regions);
  REQUIRE(places.size() == 5);
  CHECK(places[0].label == "pit");
  CHECK(places[1].region == 1);
  CHECK(places[1].isView);
  CHECK(places[1].position.y == 5.0);
  CHECK(places[1].headingDeg == 90.0);
  CHECK(places[1].radiusM == 25.0);
  CHECK(places[2].region == 5);
  CHECK_FALSE(places[2].isView);
  CHECK_FALSE(places[2].headingDeg.has_value());
  CHECK(places[2].radiusM == 60.0);
  CHECK(places[3].region == 2);
  CHECK(findPlace(places, " STOCKPILE ")->region == 2);
  CHECK(findPlace(places, "7")->label == "pit");
  CHECK(findPlace(places, "quay") == nullptr);
}

}  // namespace terraport
