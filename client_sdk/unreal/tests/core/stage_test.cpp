#include "stage_stand.h"

using namespace terraport;
using namespace terraport_tests;

TEST_SUITE("stage") {
  TEST_CASE("a landing is shown in one update, once all of it is drawable") {
    Stand stand;
    stand.update();
    CHECK(stand.stage->status().phase == LandingPhase::None);
    const std::int64_t landing = stand.land();
    CHECK(stand.stage->status().phase == LandingPhase::Planning);
    stand.planned(landing, {3, 4, 5});
    stand.arrived(landing, 3);
    stand.arrived(landing, 4);
    stand.frames(3);
    CHECK(stand.stage->status().phase == LandingPhase::Loading);
    CHECK(stand.renderer.drawable == SegmentSet{3, 4});
    CHECK(stand.renderer.shown.empty());
    stand.arrived(landing, 5);
    stand.frames(3);
    // Every byte is here, and nothing was declared yet.
    CHECK(stand.renderer.shown.empty());
    stand.ready(landing, {3, 4, 5});
    stand.update();
    CHECK(stand.renderer.shown == SegmentSet{3, 4, 5});
    CHECK(stand.renderer.swaps == 1);
    CHECK(stand.stage->status().phase == LandingPhase::Shown);
    CHECK(stand.stage->status().fraction == 1.0);
    CHECK(stand.stage->status().presentableMs > 0.0);
    CHECK_FALSE(stand.stage->isBusy());
  }

  TEST_CASE("the next landing replaces it in one update, and what it left is freed") {
    Stand stand;
    stand.whole({1, 2, 3});
    stand.frames(4);
    stand.whole({3, 4});
    stand.frames(4);
    CHECK(stand.renderer.shown == SegmentSet{3, 4});
    CHECK(stand.renderer.uploaded == SegmentSet{3, 4});
    CHECK(stand.renderer.uploads == 4);
    CHECK(stand.renderer.swaps == 2);
    CHECK(stand.renderer.frees == 2);
  }

  TEST_CASE("of two levels a landing and an aim ask for a ring, unless one is named or nobody wants it") {
    Stand stand({}, 900, 40, 2);
    stand.land();
    stand.stage->aim({1.0, 2.0, 3.0}, 20.0);
    CHECK(stand.stream.landedRingM == 180.0);
    CHECK(stand.stream.aimedRingM == 60.0);
    LandOptions own;
    own.coarseRadiusM = 70.0;
    stand.stage->land({1.0, 2.0, 3.0}, 60.0, own, 0.0);
    CHECK(stand.stream.landedRingM == 70.0);
    stand.stage->setShowsCoarse(false);
    stand.land();
    stand.stage->aim({1.0, 2.0, 3.0}, 20.0);
    CHECK_FALSE(stand.stream.landedRingM.has_value());
    CHECK_FALSE(stand.stream.aimedRingM.has_value());
    StageOptions off;
    off.showsCoarse = false;
    Stand plain(off, 900, 40, 2);
    plain.land();
    CHECK_FALSE(plain.stream.landedRingM.has_value());
    Stand one;
    one.land();
    CHECK_FALSE(one.stream.landedRingM.has_value());
  }

  TEST_CASE("a hop exchanges levels, and the base gives way to both") {
    Stand stand({}, 900, 40, 2);
    stand.whole({3, 4, 40 + 5, 40 + 9});
    stand.frames(4);
    CHECK(stand.renderer.shown == SegmentSet{3, 4, 45, 49});
    const VisibleDigest before = stand.stage->visibleDigest();
    CHECK(before.hiddenBaseFaces > 0);
    // The other way round: the same segments, so the same faces of the base.
    stand.whole({5, 9, 40 + 3, 40 + 4});
    stand.frames(4);
    CHECK(stand.renderer.shown == SegmentSet{5, 9, 43, 44});
    CHECK(stand.stage->visibleDigest().hiddenBaseHash == before.hiddenBaseHash);
    CHECK(stand.renderer.uploaded == SegmentSet{5, 9, 43, 44});
  }

  TEST_CASE("what is nearby stays uploaded, and is shown again at once") {
    Stand stand;
    stand.whole({1, 2, 3});
    stand.frames(4);
    const std::int64_t hop = stand.land();
    stand.planned(hop, {4}, {1}, {2});
    stand.arrived(hop, 4);
    stand.ready(hop, {1, 4});
    stand.frames(4);
    CHECK(stand.renderer.shown == SegmentSet{1, 4});
    CHECK(stand.renderer.uploaded == SegmentSet{1, 2, 4});
    const std::int64_t back = stand.land();
    stand.planned(back, {}, {1, 2});
    stand.ready(back, {1, 2});
    stand.frames(4);
    CHECK(stand.renderer.shown == SegmentSet{1, 2});
    CHECK(stand.renderer.uploaded == SegmentSet{1, 2});
    CHECK(stand.renderer.uploads == 4);
  }

  TEST_CASE("without autoShow it waits for show") {
    StageOptions options;
    options.autoShow = false;
    Stand stand(options);
    CHECK_FALSE(stand.stage->show());
    stand.whole({1, 2});
    stand.frames(5);
    CHECK(stand.renderer.shown.empty());
    CHECK(stand.stage->isPresentable());
    CHECK(stand.stage->status().phase == LandingPhase::Presentable);
    CHECK(stand.stage->show());
    stand.compare();
    CHECK(stand.renderer.shown == SegmentSet{1, 2});
    CHECK_FALSE(stand.stage->show());
    stand.whole({5});
    stand.frames(5);
    stand.stage->setAutoShow(true);
    stand.update();
    CHECK(stand.renderer.shown == SegmentSet{5});
  }

  TEST_CASE("the inner part first, then the whole") {
    Stand stand;
    const std::int64_t landing = stand.land();
    stand.planned(landing, {10, 11, 12, 13});
    stand.arrived(landing, 10);
    stand.arrived(landing, 11);
    stand.degraded(landing, {10, 11});
    stand.frames(4);
    CHECK(stand.renderer.shown == SegmentSet{10, 11});
    CHECK(stand.stage->status().phase == LandingPhase::ShownDegraded);
    stand.arrived(landing, 12);
    stand.arrived(landing, 13);
    stand.ready(landing, {10, 11, 12, 13});
    stand.frames(4);
    CHECK(stand.renderer.shown == SegmentSet{10, 11, 12, 13});
    CHECK(stand.renderer.swaps == 2);
  }

  TEST_CASE("a segment that does not decode is missing, and its base stays") {
    Stand stand;
    stand.stream.damaged = {7};
    stand.renderer.refused = {8};
    stand.whole({6, 7, 8, 9});
    stand.frames(5);
    CHECK(stand.renderer.shown == SegmentSet{6, 9});
    CHECK(stand.stage->status().missing == std::vector<std::uint32_t>{7, 8});
    CHECK(stand.stage->stats().decodeFailures == 2);
  }

  TEST_CASE("a newer landing wins, and what was on its way for the older is let go") {
    Stand stand;
    StageOptions options;
    const std::int64_t older = stand.land();
    stand.planned(older, {1, 2, 3});
    stand.arrived(older, 1);
    const std::int64_t newer = stand.land();
    stand.planned(newer, {20, 21});
    stand.arrived(newer, 20);
    stand.arrived(newer, 21);
    stand.ready(older, {1, 2, 3});
    stand.ready(newer, {20, 21});
    stand.frames(5);
    CHECK(stand.renderer.shown == SegmentSet{20, 21});
    CHECK(stand.renderer.swaps == 1);
  }

  TEST_CASE("a refused landing leaves what is shown") {
    Stand stand;
    stand.whole({1, 2});
    stand.frames(4);
    const std::int64_t landing = stand.land();
    stand.refused(landing);
    stand.frames(3);
    CHECK(stand.renderer.shown == SegmentSet{1, 2});
    CHECK(stand.stage->status().phase == LandingPhase::Refused);
    CHECK(stand.stage->status().refusal == "no");
  }

  TEST_CASE("what an aim brings is made drawable ahead, within its bound") {
    StageOptions options;
    options.spareGpuBytes = 2500;
    Stand stand(options);
    stand.whole({1});
    stand.frames(3);
    for (const std::uint32_t segment : {30U, 31U, 32U, 33U, 34U}) {
      stand.arrived(kNoLanding, segment);
    }
    stand.frames(6);
    CHECK(stand.renderer.uploaded.size() == 3);
    CHECK(stand.stage->stats().spareGpuBytes == 2000);
    const int before = stand.renderer.uploads;
    const std::int64_t landing = stand.land();
    stand.planned(landing, {}, {30, 31});
    stand.ready(landing, {30, 31});
    stand.update();
    stand.update();
    CHECK(stand.renderer.shown == SegmentSet{30, 31});
    CHECK(stand.renderer.uploads - before <= 1);
  }

  TEST_CASE("a frame's budget is kept but for the step in hand, and one step is done at least") {
    StageOptions options;
    Stand stand(options, 20000, 40);
    stand.renderer.uploadMs = 0.7;
    stand.renderer.blockMs = 0.4;
    SegmentSet all;
    for (std::uint32_t segment = 0; segment < 40; ++segment) {
      all.insert(segment);
    }
    stand.whole(all);
    int frames = 0;
    for (; stand.renderer.swaps == 0 && frames < 200; ++frames) {
      const double before = stand.clock.nowMs;
      stand.update(2.0);
      CHECK(stand.clock.nowMs - before - 1.0 < 2.0 + 0.7);
    }
    CHECK(stand.renderer.shown == all);
    CHECK(frames > 10);
    // No time at all: it goes on all the same.
    stand.whole({1, 2, 3});
    for (frames = 0; stand.renderer.swaps == 1 && frames < 400; ++frames) {
      stand.update(0.0);
    }
    CHECK(stand.renderer.shown == SegmentSet{1, 2, 3});
  }

  TEST_CASE("an upload in slices goes on in the next frame, and others go on meanwhile") {
    Stand stand;
    stand.renderer.slices = 3;
    stand.whole({1, 2});
    stand.update();
    CHECK(stand.renderer.slicesBySegment.size() == 2);
    stand.frames(4);
    CHECK(stand.renderer.shown == SegmentSet{1, 2});
    CHECK(stand.renderer.uploads == 6);
  }

  TEST_CASE("nothing is swapped before the base is there") {
    Stand stand;
    stand.renderer.isReady = false;
    stand.whole({1, 2});
    stand.frames(5);
    CHECK(stand.renderer.shown.empty());
    CHECK_FALSE(stand.stage->isPresentable());
    stand.renderer.isReady = true;
    stand.update();
    CHECK(stand.renderer.shown == SegmentSet{1, 2});
  }

  TEST_CASE("another version: the old stays drawn until the files are here, then the base alone, then the new") {
    Stand stand;
    stand.whole({1, 2, 3});
    stand.frames(4);
    stand.arrived(kNoLanding, 9);
    stand.frames(2);
    stand.versionChanged();
    CHECK(stand.stage->needsFiles());
    stand.stream.held.clear();
    const std::int64_t landing = stand.whole({2, 5});
    stand.frames(3);
    CHECK(stand.renderer.shown == SegmentSet{1, 2, 3});
    CHECK(stand.renderer.uploaded == SegmentSet{1, 2, 3});
    stand.stage->replaceFiles(randomFiles(99, 500, 20));
    CHECK(stand.renderer.bases == 2);
    CHECK(stand.renderer.shown.empty());
    stand.compare();
    stand.frames(4);
    CHECK(stand.renderer.shown == SegmentSet{2, 5});
    CHECK(stand.stage->status().landing == landing);
  }

  TEST_CASE("after its end nothing is left at the renderer") {
    Stand stand;
    stand.whole({1, 2, 3});
    stand.arrived(kNoLanding, 9);
    stand.frames(5);
    stand.renderer.shown.clear();  // freed while shown: only here
    stand.stage.reset();
    CHECK(stand.renderer.uploaded.empty());
  }

  TEST_CASE("whatever happens, what is drawn is a declared set, and the base is hidden by the rule") {
    for (std::uint64_t seed = 0; seed < 60; ++seed) {
      CAPTURE(seed);
      // 1. A stage with drawn limits.
      Chance chance(seed);
      StageOptions options;
      options.maxInFlight = 1 + chance.below(6);
      options.spareGpuBytes = 1000 * chance.below(8);
      options.baseBlockFaces = 1 + chance.below(200);
      options.maxFrameFrees = 1 + chance.below(4);
      Stand stand(options);
      stand.renderer.uploadMs = 0.2;
      stand.renderer.slices = 1 + static_cast<int>(chance.below(3));
      // What the stream would know: its newest landing, that landing's plan, and every set that was ever declared.
      std::int64_t landing = kNoLanding;
      SegmentSet load;
      SegmentSet keep;
      std::vector<SegmentSet> declared = {{}};
      const auto randomSubset = [&](double share) {
        SegmentSet out;
        for (std::uint32_t segment = 0; segment < 40; ++segment) {
          if (chance.share() < share) {
            out.insert(segment);
          }
        }
        return out;
      };
      bool hasPlan = false;
      for (int step = 0; step < 250; ++step) {
        // 2. Something that a stream may report next.
        switch (chance.below(12)) {
          case 0:
            if (chance.share() < 0.5) {
              landing = stand.land();
              hasPlan = false;
            }
            break;
          case 1:
            if (landing != kNoLanding && !hasPlan) {
              load.clear();
              keep.clear();
              for (const std::uint32_t segment : randomSubset(0.4)) {
                (stand.stream.held.count(segment) != 0 ? keep : load).insert(segment);
              }
              stand.planned(landing, load, keep);
              hasPlan = true;
            }
            break;
          case 2:
          case 3:
            if (hasPlan) {
              for (const std::uint32_t segment : load) {
                if (chance.share() < 0.5) {
                  stand.arrived(landing, segment);
                }
              }
            }
            break;
          case 4:
            if (hasPlan && chance.share() < 0.6) {
              SegmentSet all = keep;
              for (const std::uint32_t segment : load) {
                stand.arrived(landing, segment);
                all.insert(segment);
              }
              declared.push_back(all);
              stand.ready(landing, all);
            }
            break;
          case 5:
            if (hasPlan && !keep.empty() && chance.share() < 0.3) {
              declared.push_back(keep);
              stand.degraded(landing, keep);
            }
            break;
          case 6:
            stand.arrived(kNoLanding, chance.below(40));
            break;
          case 7:
            if (chance.share() < 0.2 && landing != kNoLanding) {
              stand.refused(landing);
              hasPlan = false;
              landing = kNoLanding;
            }
            break;
          case 8:
            if (chance.share() < 0.1) {
              const std::uint32_t segment = chance.below(40);
              if (stand.renderer.shown.count(segment) == 0) {
                stand.dropped({segment});
                load.erase(segment);
                keep.erase(segment);
              }
            }
            break;
          case 9:
            if (chance.share() < 0.1) {
              stand.versionChanged();
              stand.update();
              stand.stream.held.clear();
              stand.stage->replaceFiles(randomFiles(seed * 1000 + static_cast<std::uint64_t>(step), 900, 40));
              hasPlan = false;
              landing = kNoLanding;
            }
            break;
          default:
            break;
        }
        // 3. One frame, after which the stand compares what is drawn with the stage and with the rule.
        stand.update(0.5);
        CHECK(stand.stage->stats().spareGpuBytes <= options.spareGpuBytes);
        const SegmentSet shown = stand.renderer.shown;
        // Nothing is ever drawn that was not declared, whole but for what could not be had.
        CHECK(std::any_of(declared.begin(), declared.end(),
            [&](const SegmentSet& set) { return std::includes(set.begin(), set.end(), shown.begin(), shown.end()); }));
      }
    }
  }
}
