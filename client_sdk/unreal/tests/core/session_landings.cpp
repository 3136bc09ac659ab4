// Landings, supersede and resume: the client's state machine against the model server.
#include "session_pair.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <set>

using namespace terraport;
using namespace terraport::testing;

namespace {

using Ids = std::vector<std::uint32_t>;

std::vector<std::int64_t> landingsOf(const std::vector<StreamEvent>& events) {
  std::vector<std::int64_t> numbers;
  for (const StreamEvent& event : events) numbers.push_back(event.landing);
  return numbers;
}

}  // namespace

TEST_CASE("session: a landing shows exactly what brute force finds") {
  Pair pair(kToy);
  pair.connect();
  const std::int64_t number = pair.client.land(kMiddle, 4, {});
  pair.settle();
  const Ids want = kToy.within(kMiddle, 4);
  REQUIRE(want.size() > 5);
  const auto ready = pair.of(EventKind::Ready);
  REQUIRE(ready.size() == 1);
  CHECK(ready[0].landing == number);
  CHECK(ready[0].segments == want);
  CHECK(ready[0].missing.empty());
  CHECK(ready[0].payloadBytes == kToy.bytesOf(want));
  CHECK(pair.server->chunkBytes == kToy.bytesOf(want));
  CHECK(pair.client.transfers().payloadBytes() == kToy.bytesOf(want));
  CHECK(pair.client.transfers().visible() == want);
  for (const std::uint32_t segment : want) CHECK(pair.holds(segment));
}

TEST_CASE("session: a landing costs no bytes the second time") {
  Pair pair(kToy);
  pair.connect();
  for (int visit = 0; visit < 2; ++visit) {
    pair.client.land(kMiddle, 4, {});
    pair.settle();
  }
  const auto planned = pair.of(EventKind::Planned);
  REQUIRE(planned.size() == 2);
  CHECK(planned[1].plan.loadBytes == 0);
  CHECK(planned[1].plan.keep.size() == planned[0].plan.load.size());
  CHECK(pair.of(EventKind::Ready)[1].payloadBytes == 0);
  CHECK(isOnce(pair.received));
}

TEST_CASE("session: a landing keeps what lies a little beyond its radius, and does not show it (6.6)") {
  PairOptions options;
  options.cacheBytes = 0;
  options.releaseFactor = 1.5;
  Pair pair(kToy, options);
  pair.connect();
  for (const double radiusM : {6.0, 4.5, 6.0}) {
    pair.client.land(kMiddle, radiusM, {});
    pair.settle();
    CHECK(pair.client.transfers().visible() == kToy.within(kMiddle, radiusM));
  }
  const auto plans = pair.of(EventKind::Planned);
  REQUIRE(plans.size() == 3);
  const Ids less = kToy.within(kMiddle, 4.5);
  Ids nearby;
  for (const std::uint32_t segment : kToy.within(kMiddle, 6)) {
    if (std::find(less.begin(), less.end(), segment) == less.end()) nearby.push_back(segment);
  }
  CHECK(plans[1].plan.nearby == nearby);
  CHECK_FALSE(nearby.empty());
  CHECK(plans[2].plan.load.empty());
  CHECK(pair.of(EventKind::Dropped).empty());
}

TEST_CASE("session: a landing is not ready before the server says so, though it is whole (6.4, rule 5)") {
  Pair pair(kToy);
  pair.connect();
  pair.client.land(kMiddle, 4, {});
  while (pair.received.size() < kToy.within(kMiddle, 4).size()) REQUIRE(pair.step());
  CHECK(pair.of(EventKind::Ready).empty());
  CHECK(pair.client.transfers().visible().empty());
  pair.settle();
  CHECK(pair.of(EventKind::Ready).size() == 1);
}

TEST_CASE("session: a landing comes whole however small the credit, granted in steps of half of it") {
  Pair tiny(kToy, withCredit(1));
  tiny.connect();
  tiny.client.land({0, 0, 0}, 0.5, {});
  tiny.settle();
  CHECK(tiny.client.transfers().visible() == Ids{0});
  PairOptions options = withCredit(4000);
  options.maxChunk = 100;
  Pair pair(kToy, options);
  pair.connect();
  pair.client.land(kMiddle, 9, {});
  pair.settle();
  std::size_t grants = 0;
  for (const ClientMessage& message : pair.server->heard) {
    if (const auto* const credit = std::get_if<CreditMessage>(&message)) {
      grants += 1;
      CHECK(credit->bytes < 2100);
    }
  }
  CHECK(grants == kToy.bytesOf(kToy.within(kMiddle, 9)) / 2000);
}

TEST_CASE("session: grants that were not sent yet add up to one message") {
  Pair pair(kToy, withCredit(100));
  pair.connect();
  pair.settle();
  pair.client.land(kMiddle, 4, {});
  for (const EncodedMessage& message : pair.client.takeMessages()) pair.server->receive(message);
  pair.server->credit = 1 << 20;
  while (auto data = pair.server->next()) pair.give(*data);
  CHECK(pair.of(EventKind::Ready).size() == 1);
  CHECK(pair.client.takeMessages().size() == 1);
}

TEST_CASE("session: a landing keeps to the budgets, and says what they left out") {
  for (int which = 0; which < 3; ++which) {
    PairOptions options;
    if (which == 0) options.budgets.maxSegments = 3;
    if (which == 1) options.budgets.maxTriangles = 39;
    if (which == 2) options.budgets.maxBytes = 2000;
    Pair pair(kToy, options);
    pair.connect();
    pair.client.land(kMiddle, 4, {});
    pair.settle();
    const PlanFacts plan = pair.of(EventKind::Planned)[0].plan;
    const Ids visible = pair.client.transfers().visible();
    CHECK(!visible.empty());
    if (which < 2) CHECK(visible.size() == 3);
    if (which == 2) CHECK(kToy.bytesOf(visible) <= 2000);
    CHECK(plan.omittedBy == std::vector<const char*>{"max_segments", "max_triangles", "max_bytes"}[which]);
    CHECK(plan.omittedSegments == kToy.within(kMiddle, 4).size() - visible.size());
    CHECK(plan.effectiveRadiusM < 4);
  }
}

TEST_CASE("session: a landing declares the inner set after its deadline, as soon as that is whole here, and goes on") {
  Pair pair(kToy, withCredit(2000));
  pair.connect();
  pair.settle();
  LandOptions options;
  options.innerRadiusM = 1.5;
  options.deadlineMs = 100;
  pair.client.land(kMiddle, 5, options);
  const Ids inner = kToy.within(kMiddle, 1.5);
  while (pair.received.size() < inner.size()) REQUIRE(pair.step());
  pair.server->isDeadlinePassed = true;
  pair.settle();
  const auto degraded = pair.of(EventKind::Degraded);
  REQUIRE(degraded.size() == 1);
  CHECK(degraded[0].segments == inner);
  CHECK(pair.client.transfers().visible() == kToy.within(kMiddle, 5));
}

TEST_CASE("session: a landing is not declared degraded with a segment that came wrong") {
  PairOptions pairOptions;
  pairOptions.lag = 30;
  Pair pair(kToy, pairOptions);
  pair.connect();
  pair.settle();
  int spoilt = 0;
  pair.spoil = [&spoilt](EncodedMessage& data) {
    if (spoilt++ == 0) flip(data);
  };
  LandOptions options;
  options.innerRadiusM = 1.5;
  options.deadlineMs = 100;
  pair.client.land(kMiddle, 5, options);
  pair.step();
  pair.server->isDeadlinePassed = true;
  pair.settle();
  const Ids inner = kToy.within(kMiddle, 1.5);
  REQUIRE(pair.rejected().size() == 1);
  CHECK(std::count(inner.begin(), inner.end(), pair.rejected()[0]) == 1);
  std::set<std::uint32_t> before;
  bool isDegraded = false;
  for (const SessionEvent& event : pair.events) {
    if (event.news != SessionNews::Stream || isDegraded) continue;
    isDegraded = event.stream.kind == EventKind::Degraded;
    if (event.stream.kind == EventKind::Arrived) before.insert(event.stream.facts.segment);
  }
  CHECK(isDegraded);
  for (const std::uint32_t segment : inner) CHECK(before.count(segment) == 1);
}

TEST_CASE("session: a landing without what the server cannot read is ready; the next one tries again (6.4, rule 6)") {
  Pair pair(kToy);
  pair.connect();
  pair.server->unreadable.insert(14);
  pair.client.land(kMiddle, 4, {});
  pair.settle();
  Ids want = kToy.within(kMiddle, 4);
  CHECK(pair.of(EventKind::Ready)[0].missing == Ids{14});
  Ids without = want;
  without.erase(std::find(without.begin(), without.end(), 14u));
  CHECK(pair.client.transfers().visible() == without);
  pair.server->unreadable.clear();
  pair.client.land(kMiddle, 4, {});
  pair.settle();
  CHECK(pair.client.transfers().visible() == want);
}

TEST_CASE("session: a landing that a newer one ends before its plan never gets one") {
  const ToyScene scene;
  Pair pair(scene);
  pair.connect();
  pair.settle();
  pair.server->plansNothing = true;
  const std::int64_t first = pair.client.land(kMiddle, 4, {});
  pair.settle();
  pair.server->plansNothing = false;
  const std::int64_t second = pair.client.land(kMiddle, 2, {});
  pair.settle();
  const auto superseded = pair.of(EventKind::Superseded);
  REQUIRE(superseded.size() == 1);
  CHECK(superseded[0].landing == first);
  CHECK(superseded[0].by == second);
  CHECK(landingsOf(pair.of(EventKind::Planned)) == std::vector<std::int64_t>{second});
  CHECK(landingsOf(pair.of(EventKind::Ready)) == std::vector<std::int64_t>{second});
}

TEST_CASE("session: a newer landing supersedes, and what is half here goes on") {
  const ToyScene scene(5000);
  Pair pair(scene, withCredit(100));
  pair.connect();
  const std::int64_t first = pair.client.land({0, 0, 0}, 1, {});
  while (pair.server->chunkBytes < 300) REQUIRE(pair.step());
  const std::int64_t second = pair.client.land({0, 0, 0}, 2, {});
  pair.settle();
  const auto superseded = pair.of(EventKind::Superseded);
  REQUIRE(superseded.size() == 1);
  CHECK(superseded[0].landing == first);
  CHECK(superseded[0].by == second);
  CHECK(landingsOf(pair.of(EventKind::Ready)) == std::vector<std::int64_t>{second});
  CHECK(pair.server->chunkBytes == scene.bytesOf(scene.within({0, 0, 0}, 2)));
}

TEST_CASE("session: a newer landing somewhere else makes the parts of the older one forgotten") {
  const ToyScene scene(5000);
  Pair pair(scene, withCredit(100));
  pair.connect();
  pair.client.land({0, 0, 0}, 1, {});
  while (pair.server->chunkBytes < 300) REQUIRE(pair.step());
  CHECK(pair.client.transfers().partialSegments() == 1);
  pair.client.land({10, 0, 10}, 0.5, {});
  while (pair.of(EventKind::Planned).size() < 2) REQUIRE(pair.step());
  CHECK(pair.client.transfers().partialSegments() == 0);
}

TEST_CASE("session: a newer landing that is refused leaves the older one going (6.5, rule 5)") {
  Pair pair(kToy);
  pair.connect();
  const std::int64_t accepted = pair.client.land(kMiddle, 4, {});
  for (int step = 0; step < 3; ++step) pair.step();
  const std::int64_t tooLarge = pair.client.land(kMiddle, 501, {});
  pair.settle();
  const auto refused = pair.of(EventKind::Refused);
  REQUIRE(refused.size() == 1);
  CHECK(refused[0].landing == tooLarge);
  CHECK(refused[0].code == "radius_too_large");
  CHECK(!refused[0].fatal);
  CHECK(landingsOf(pair.of(EventKind::Ready)) == std::vector<std::int64_t>{accepted});
  CHECK(pair.of(EventKind::Superseded).empty());
}

TEST_CASE("session: only the newest landing waits for a connection") {
  Pair pair(kToy);
  const std::int64_t first = pair.client.land({0, 0, 0}, 1, {});
  const std::int64_t second = pair.client.land(kMiddle, 1, {});
  pair.connect().settle();
  CHECK(landingsOf(pair.of(EventKind::Superseded)) == std::vector<std::int64_t>{first});
  CHECK(landingsOf(pair.of(EventKind::Ready)) == std::vector<std::int64_t>{second});
}

TEST_CASE("session: a landing takes the place of one that never left: one `land` waits to be sent at most") {
  Pair pair(kToy);
  pair.connect().settle();
  for (int count = 0; count < 100; ++count) pair.client.land(kMiddle, 1 + count / 50.0, {});
  pair.client.pick({0, 0, 0}, {});
  const auto messages = pair.client.takeMessages();
  CHECK(messages.size() == 2);
  for (const EncodedMessage& message : messages) pair.server->receive(message);
  pair.settle();
  CHECK(pair.of(EventKind::Superseded).size() == 99);
  CHECK(landingsOf(pair.of(EventKind::Ready)) == std::vector<std::int64_t>{100});
  CHECK(pair.client.transfers().visible() == kToy.within(kMiddle, 1 + 99 / 50.0));
}

TEST_CASE("session: a landing that a cut ended is resumed, and no segment comes twice") {
  for (int steps = 0; steps < 60; steps += 2) {
    CAPTURE(steps);
    Pair pair(kToy, withCredit(300));
    pair.connect();
    const std::int64_t number = pair.client.land(kMiddle, 4, {});
    for (int step = 0; step < steps; ++step) pair.step();
    pair.disconnect();
    CHECK((pair.client.unfinished() == number || pair.of(EventKind::Ready).size() == 1));
    CHECK(pair.client.transfers().partialSegments() == 0);
    pair.connect().settle();
    const Ids want = kToy.within(kMiddle, 4);
    const auto ready = pair.of(EventKind::Ready);
    REQUIRE(!ready.empty());
    CHECK(ready.back().landing == number);
    CHECK(ready.back().segments == want);
    CHECK(pair.receivedSorted() == want);
    CHECK(pair.client.transfers().repeatedBytes() == 0);
  }
}

TEST_CASE("session: a lost connection makes what the old one said of ready void") {
  Pair pair(kToy);
  pair.connect().settle();
  int frames = 0;
  pair.spoil = [&frames](EncodedMessage& data) {
    if (frames++ == 0) flip(data);
  };
  const std::int64_t number = pair.client.land({0, 0, 0}, 0.5, {});
  while (frames == 0) REQUIRE(pair.step());
  // The reject of it waits in the outbox while the server says ready.
  pair.give(*pair.server->next());
  CHECK(pair.rejected().size() == 1);
  CHECK(pair.of(EventKind::Ready).empty());
  pair.disconnect();
  pair.connect();
  while (pair.received.empty()) REQUIRE(pair.step());
  CHECK(pair.of(EventKind::Ready).empty());
  pair.settle();
  CHECK(landingsOf(pair.of(EventKind::Ready)) == std::vector<std::int64_t>{number});
}

TEST_CASE("session: a lost connection leaves what is shown until the new landing is ready (10.3)") {
  Pair pair(kToy);
  pair.connect();
  pair.client.land({0, 0, 0}, 2, {});
  pair.settle();
  const Ids shown = pair.client.transfers().visible();
  pair.client.land(kMiddle, 4, {});
  pair.step();
  pair.disconnect();
  pair.connect();
  CHECK(pair.client.transfers().visible() == shown);
  pair.settle();
  CHECK(pair.client.transfers().visible() == kToy.within(kMiddle, 4));
}
