// Aims: the client's state machine against the model server.
#include "session_pair.h"

#include <doctest/doctest.h>

#include <set>

using namespace terraport;
using namespace terraport::testing;

using Ids = std::vector<std::uint32_t>;

TEST_CASE("session: an aim is held for the landing that follows, which costs nothing") {
  Pair pair(kToy);
  pair.connect().settle();
  pair.client.aim(kMiddle, 3);
  CHECK(pair.client.hasAim());
  pair.client.flushAim();
  pair.settle();
  const Ids want = kToy.within(kMiddle, 3);
  const auto prefetching = pair.of(EventKind::Prefetching);
  REQUIRE(prefetching.size() == 1);
  CHECK(prefetching[0].segmentCount == want.size());
  CHECK(prefetching[0].payloadBytes == kToy.bytesOf(want));
  CHECK(pair.of(EventKind::Prefetched).size() == 1);
  CHECK(pair.client.transfers().visible().empty());
  pair.client.land(kMiddle, 3, {});
  pair.settle();
  CHECK(pair.of(EventKind::Planned).back().plan.loadBytes == 0);
  CHECK(pair.client.transfers().visible() == want);
  const AimCounts& aims = pair.client.transfers().aims();
  CHECK(aims.landings == 1);
  CHECK(aims.hits == 1);
  CHECK(aims.usedBytes == kToy.bytesOf(want));
  CHECK(aims.prefetchedBytes == kToy.bytesOf(want));
}

TEST_CASE("session: an aim elsewhere is a miss, and counted; older ones are replaced; a landing drops it") {
  Pair pair(kToy);
  pair.connect().settle();
  for (int x = 5; x >= 0; --x) pair.client.aim({static_cast<double>(x), 0, 0}, 1);
  pair.client.flushAim();
  pair.settle();
  CHECK(pair.server->heardTypes() == std::vector<std::string>{"hello", "aim"});
  pair.client.aim({1, 0, 1}, 1);
  pair.client.land(kMiddle, 2, {});
  CHECK(!pair.client.hasAim());
  pair.settle();
  const AimCounts& aims = pair.client.transfers().aims();
  CHECK(aims.landings == 1);
  CHECK(aims.hits == 0);
  CHECK(aims.usedBytes == 0);
  CHECK(aims.prefetchedBytes == kToy.bytesOf(kToy.within({0, 0, 0}, 1)));
}

TEST_CASE("session: an aim that comes wrong twice is given up") {
  Pair pair(kToy);
  pair.connect().settle();
  pair.spoil = flip;
  pair.client.aim({0, 0, 0}, 0.5);
  pair.client.flushAim();
  pair.settle();
  CHECK(pair.rejected() == Ids{0, 0});
  CHECK(pair.of(EventKind::Prefetched).size() == 1);
  CHECK(!pair.client.holdings().has(0));
}

TEST_CASE("session: an aim that a cut ended is sent anew, and nothing comes twice (7, rule 4)") {
  Pair pair(kToy, withCredit(300));
  pair.connect().settle();
  pair.client.aim(kMiddle, 3);
  pair.client.flushAim();
  while (pair.received.size() < 2) REQUIRE(pair.step());
  pair.disconnect();
  pair.connect().settle(true);
  CHECK(pair.receivedSorted() == kToy.within(kMiddle, 3));
  CHECK(pair.of(EventKind::Prefetched).size() == 1);
  pair.client.land(kMiddle, 3, {});
  pair.settle();
  CHECK(pair.of(EventKind::Planned).back().plan.loadBytes == 0);
}

TEST_CASE("session: an aim is not sent anew once all has come, or the user has landed") {
  Pair pair(kToy);
  pair.connect().settle();
  pair.client.aim(kMiddle, 3);
  pair.client.flushAim();
  pair.settle();
  pair.disconnect();
  pair.connect().settle();
  CHECK(!pair.client.hasAim());
  pair.client.aim({0, 0, 0}, 3);
  pair.client.flushAim();
  pair.client.land(kMiddle, 3, {});
  pair.disconnect();
  pair.connect().settle();
  CHECK(!pair.client.hasAim());
  CHECK(pair.of(EventKind::Ready).back().segments == kToy.within(kMiddle, 3));
}

TEST_CASE("session: an aim after an unfinished landing comes behind it again") {
  Pair pair(kToy, withCredit(300));
  pair.connect().settle();
  pair.client.land(kMiddle, 3, {});
  pair.client.aim({0, 0, 0}, 2);
  pair.client.flushAim();
  while (pair.received.empty()) REQUIRE(pair.step());
  pair.disconnect();
  pair.connect().settle(true);
  std::vector<EventKind> kinds;
  for (const SessionEvent& event : pair.events) {
    const bool isEnd = event.stream.kind == EventKind::Ready || event.stream.kind == EventKind::Prefetched;
    if (event.news == SessionNews::Stream && isEnd) kinds.push_back(event.stream.kind);
  }
  CHECK(kinds == std::vector<EventKind>{EventKind::Ready, EventKind::Prefetched});
  CHECK(isOnce(pair.received));
}
