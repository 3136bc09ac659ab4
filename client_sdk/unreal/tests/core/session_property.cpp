// Random landings, aims, cuts and flipped bits: the last landing alone decides what is visible.
#include "session_pair.h"

#include <doctest/doctest.h>

#include <set>

using namespace terraport;
using namespace terraport::testing;

namespace {

constexpr int kSeeds = 150;

/// One random history between a client and the model server, ended by a landing that is let finish.
void runHistory(int seed, bool spoils) {
  // 1. Both sides, with drawn options and a drawn delay between them.
  CAPTURE(seed);
  CAPTURE(spoils);
  Seeded random(static_cast<std::uint32_t>(seed));
  const auto position = [&random] { return Vec3{random() * 16 - 2, 0, random() * 16 - 2}; };
  const auto radiusM = [&random] { return 0.5 + random() * 7.5; };
  PairOptions options;
  options.cacheBytes = random.oneOf<std::uint64_t>({0, 2000, 8000, 1 << 20});
  options.creditBytes = random.oneOf<std::uint64_t>({50, 700, 1 << 20});
  options.lag = random.oneOf<std::size_t>({0, 1, 5, 30});
  options.maxChunk = random.oneOf({7, 100, 100000});
  options.releaseFactor = random.oneOf({1.0, 1.5});
  options.maxHeldSegments = random.oneOf<std::uint32_t>({1, 5, 1000});
  options.random = [&random] { return random(); };
  Pair pair(kToy, options);
  pair.offersHeld = random() < 0.5;
  pair.connect();
  bool spoilsNext = false;
  pair.spoil = [&spoilsNext](EncodedMessage& data) {
    if (spoilsNext) flip(data);
    spoilsNext = false;
  };
  // 2. Landings, aims, cuts, flipped bits, and steps of the network, in any order.
  for (int step = random.below(25); step > 0; --step) {
    switch (random.below(6)) {
      case 0:
        pair.client.land(position(), radiusM(), {});
        break;
      case 1:
        pair.client.aim(position(), radiusM());
        pair.client.flushAim();
        break;
      case 2:
        pair.disconnect();
        pair.connect();
        break;
      case 3:
        spoilsNext = spoils;
        break;
      default:
        for (int count = random.below(60); count > 0; --count) pair.step();
    }
  }
  // 3. The last landing alone decides what is visible, and nothing is left under way.
  spoilsNext = false;
  pair.client.land(kMiddle, 3.3, {});
  pair.settle();
  REQUIRE_MESSAGE(pair.violation.isOk(), pair.violation.message());
  const std::vector<std::uint32_t> visible = pair.client.transfers().visible();
  const PlanFacts plan = pair.of(EventKind::Planned).back().plan;
  std::set<std::uint32_t> planned(plan.keep.begin(), plan.keep.end());
  for (const SegmentFacts& facts : plan.load) planned.insert(facts.segment);
  CHECK(visible == std::vector<std::uint32_t>(planned.begin(), planned.end()));
  CHECK(visible == kToy.within(kMiddle, 3.3));
  CHECK(pair.client.unfinished() == kNoLanding);
  CHECK(pair.client.transfers().partialSegments() == 0);
  CHECK(pair.client.transfers().repeatedBytes() == 0);
  if (!spoils) CHECK(pair.rejected().empty());
  // 4. Memory keeps to its bound, but for what is pinned.
  std::vector<std::uint32_t> pinned = visible;
  pinned.insert(pinned.end(), plan.nearby.begin(), plan.nearby.end());
  CHECK(pair.client.holdings().bytes() <= std::max(options.cacheBytes, kToy.bytesOf(pinned)));
  for (const std::uint32_t segment : visible) CHECK(pair.holds(segment));
  // 5. What was reported as arrived and not as dropped is held, and nothing else.
  std::set<std::uint32_t> arrived;
  std::set<std::int64_t> ends;
  for (const SessionEvent& event : pair.events) {
    if (event.news != SessionNews::Stream) continue;
    if (event.stream.kind == EventKind::Arrived) arrived.insert(event.stream.facts.segment);
    if (event.stream.kind == EventKind::Dropped) {
      for (const std::uint32_t segment : event.stream.segments) arrived.erase(segment);
    }
    // Every landing ends in one way: ready, superseded, or the last one.
    if (event.stream.kind == EventKind::Ready || event.stream.kind == EventKind::Superseded) {
      CHECK(ends.insert(event.stream.landing).second);
    }
  }
  CHECK(arrived.size() == pair.client.holdings().count());
  for (const std::uint32_t segment : arrived) CHECK(pair.client.holdings().has(segment));
  // 6. What the server believes held is here, once the next landing has sent the evictions.
  pair.client.land(kMiddle, 3.3, {});
  pair.settle();
  for (const auto& believed : pair.server->held) CHECK(pair.client.holdings().has(believed.first));
}

}  // namespace

TEST_CASE("session: whatever happens, the visible set is that of the last landing") {
  for (int seed = 0; seed < kSeeds; ++seed) runHistory(seed, false);
}

TEST_CASE("session: whatever happens, and with flipped bits") {
  for (int seed = 0; seed < kSeeds; ++seed) runHistory(seed + kSeeds, true);
}
