#include <doctest/doctest.h>

#include "Terraport/CoverCounters.h"
#include "Terraport/CoverFile.h"
#include "stage_stand.h"

using namespace terraport;
using namespace terraport_tests;

TEST_SUITE("cover counters") {
  TEST_CASE("hidden is what the rule says, after any number of changes in any order") {
    for (std::uint64_t seed = 0; seed < 20; ++seed) {
      CAPTURE(seed);
      Chance chance(seed);
      const SharedSceneFiles files = randomFiles(seed, 1500, 60);
      CoverCounters counters;
      REQUIRE(counters.begin(files->cover).isOk());
      SegmentSet shown;
      std::vector<std::uint8_t> before(1500, 0);
      for (int step = 0; step < 200; ++step) {
        // Ids beyond every list are remembered, and hide nothing.
        const std::uint32_t segment = chance.below(64);
        std::vector<std::uint32_t> changed;
        if (chance.share() < 0.55) {
          counters.add(segment, changed);
          shown.insert(segment);
        } else {
          counters.remove(segment, changed);
          shown.erase(segment);
        }
        for (const std::uint32_t face : changed) {
          before[face] ^= 1;
        }
        CHECK(before == counters.hidden());
        CHECK(counters.hidden() == hiddenBy(files->cover, shown));
        CHECK(counters.hiddenCount() == static_cast<std::uint32_t>(std::count(before.begin(), before.end(), 1)));
      }
      // The hash belongs to the set, not to the way there.
      const std::uint32_t hash = counters.hiddenHash();
      CoverCounters again;
      REQUIRE(again.begin(files->cover).isOk());
      std::vector<std::uint32_t> changed;
      for (auto at = shown.rbegin(); at != shown.rend(); ++at) {
        again.add(*at, changed);
      }
      CHECK(again.hiddenHash() == hash);
    }
  }

  TEST_CASE("a rim is where some but not all are shown") {
    Cover cover;
    cover.offsets = {0, 1, 3, 3};
    cover.segments = {0, 0, 1};
    CoverCounters counters;
    REQUIRE(counters.begin(cover).isOk());
    std::vector<std::uint32_t> changed;
    counters.add(0, changed);
    CHECK(changed == std::vector<std::uint32_t>{0});
    CHECK_FALSE(counters.isRim(0));
    CHECK(counters.isRim(1));
    CHECK_FALSE(counters.isRim(2));
    CHECK(counters.hidden() == std::vector<std::uint8_t>{1, 0, 0});
  }

  TEST_CASE("arrays that are no cover are refused") {
    CoverCounters counters;
    Cover falling;
    falling.offsets = {0, 2, 1, 3};
    falling.segments = {0, 1, 2};
    CHECK_FALSE(counters.begin(falling).isOk());
    CHECK(counters.faceCount() == 0);
    Cover twice;
    twice.offsets = {0, 2};
    twice.segments = {4, 4};
    CHECK_FALSE(counters.begin(twice).isOk());
    Cover far;
    far.offsets = {0, 1};
    far.segments = {0xFFFFFFFFU};
    CHECK_FALSE(counters.begin(far).isOk());
    CHECK_FALSE(counters.begin(Cover()).isOk());
  }

  TEST_CASE("mix32 gives every client the same numbers") {
    // By the web client.
    CHECK(mix32(0) == 301794027U);
    CHECK(mix32(41) == 1716251024U);
  }
}
