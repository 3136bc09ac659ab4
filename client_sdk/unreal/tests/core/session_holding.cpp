// What is evicted, rejected, offered and dropped: the state machine against the model server.
#include "session_pair.h"

#include <doctest/doctest.h>

using namespace terraport;
using namespace terraport::testing;

namespace {

using Ids = std::vector<std::uint32_t>;

PairOptions withCache(std::uint64_t cacheBytes) {
  PairOptions options;
  options.cacheBytes = cacheBytes;
  return options;
}

std::vector<ClientMessage> sentMessages(ClientSession& client) {
  std::vector<ClientMessage> messages;
  MessageReader reader;
  for (const EncodedMessage& data : client.takeMessages()) {
    DecodeError error;
    messages.emplace_back();
    REQUIRE(reader.read(data.view(), messages.back(), error));
  }
  return messages;
}

}  // namespace

TEST_CASE("session: evictions are told before the next landing, and as events at once") {
  Pair pair(kToy, withCache(0));
  pair.connect();
  for (const double at : {0.0, 10.0, 0.0}) {
    pair.client.land({at, 0, at}, 2, {});
    pair.settle();
  }
  const auto planned = pair.of(EventKind::Planned);
  CHECK(planned[2].plan.loadBytes == planned[0].plan.loadBytes);
  CHECK(planned[2].plan.loadBytes > 0);
  Ids dropped = pair.of(EventKind::Dropped).back().segments;
  std::sort(dropped.begin(), dropped.end());
  CHECK(dropped == kToy.within({10, 0, 10}, 2));
  Ids beyond;
  for (const auto& row : pair.server->held) {
    if (!pair.client.holdings().has(row.first)) beyond.push_back(row.first);
  }
  pair.client.land({0, 0, 0}, 2, {});
  const auto messages = sentMessages(pair.client);
  REQUIRE(messages.size() == 2);
  REQUIRE(std::holds_alternative<EvictMessage>(messages[0]));
  CHECK(std::get<EvictMessage>(messages[0]).segments == beyond);
  CHECK(std::holds_alternative<LandMessage>(messages[1]));
}

TEST_CASE("session: evictions never come between a landing and its plan (6.7, rule 2)") {
  Pair pair(kToy, withCache(0));
  pair.connect();
  pair.client.land({0, 0, 0}, 2, {});
  pair.settle();
  pair.client.land({10, 0, 10}, 2, {});
  pair.settle();
  pair.client.land({0, 0, 0}, 2, {});
  for (const EncodedMessage& data : pair.client.takeMessages()) pair.server->receive(data);
  pair.client.land({10, 0, 10}, 2, {});
  const auto data = pair.client.takeMessages();
  CHECK(data.size() == 1);
  for (const EncodedMessage& message : data) pair.server->receive(message);
  CHECK(pair.server->heardTypes().back() == "land");
  pair.settle();
  CHECK(pair.client.transfers().visible() == kToy.within({10, 0, 10}, 2));
}

TEST_CASE("session: evictions wait where a landing becomes ready while a newer one has no plan") {
  Pair pair(kToy, withCache(0));
  pair.connect();
  pair.client.land({0, 0, 0}, 2, {});
  pair.settle();
  pair.client.land({10, 0, 10}, 2, {});
  const std::size_t all = pair.received.size() + kToy.within({10, 0, 10}, 2).size();
  while (pair.received.size() < all) REQUIRE(pair.step());
  pair.client.land({0, 0, 0}, 2, {});
  const auto onTheirWay = pair.client.takeMessages();
  pair.give(*pair.server->next());
  CHECK(pair.client.transfers().visible() == kToy.within({10, 0, 10}, 2));
  for (const EncodedMessage& data : onTheirWay) pair.server->receive(data);
  pair.settle();
  CHECK(pair.rejected().empty());
  CHECK(pair.of(EventKind::Planned).back().plan.loadBytes == 0);
  CHECK(pair.client.transfers().visible() == kToy.within({0, 0, 0}, 2));
}

TEST_CASE("session: evictions are not told to a new connection: what it is not offered, it does not count on") {
  Pair pair(kToy, withCache(0));
  pair.connect();
  for (const double at : {0.0, 10.0}) {
    pair.client.land({at, 0, at}, 2, {});
    pair.settle();
  }
  CHECK(pair.of(EventKind::Dropped).size() == 1);
  pair.disconnect();
  pair.connect().settle();
  pair.client.land({0, 0, 0}, 2, {});
  pair.settle();
  CHECK(pair.server->heardTypes() == std::vector<std::string>{"hello", "land"});
}

TEST_CASE("session: evictions spare what a degraded landing shows until it is ready") {
  Pair pair(kToy, withCache(0));
  pair.connect().settle();
  LandOptions options;
  options.innerRadiusM = 1;
  options.deadlineMs = 1;
  pair.client.land({0, 0, 0}, 5, options);
  while (pair.received.size() < 3) REQUIRE(pair.step());
  pair.server->isDeadlinePassed = true;
  while (pair.of(EventKind::Degraded).empty()) REQUIRE(pair.step());
  pair.client.land({10, 0, 10}, 0.5, {});
  while (pair.of(EventKind::Planned).size() < 2) REQUIRE(pair.step());
  const Ids inner = kToy.within({0, 0, 0}, 1);
  REQUIRE(!inner.empty());
  for (const std::uint32_t segment : inner) CHECK(pair.client.holdings().has(segment));
  pair.settle();
  for (const std::uint32_t segment : inner) CHECK(!pair.client.holdings().has(segment));
}

TEST_CASE("session: a flipped byte is rejected, and the segment sent again") {
  Pair pair(kToy);
  pair.connect();
  int spoilt = 0;
  pair.spoil = [&spoilt](EncodedMessage& data) {
    if (segmentOf(data) == 14 && spoilt++ == 0) flip(data);
  };
  pair.client.land(kMiddle, 4, {});
  pair.settle();
  CHECK(pair.rejected() == Ids{14});
  CHECK(pair.of(EventKind::Ready).back().missing.empty());
  CHECK(pair.holds(14));
}

TEST_CASE("session: a byte flipped twice leaves the segment missing; the next landing tries again") {
  Pair pair(kToy);
  pair.connect();
  pair.spoil = [](EncodedMessage& data) {
    if (segmentOf(data) == 14) flip(data);
  };
  pair.client.land(kMiddle, 4, {});
  pair.settle();
  CHECK(pair.rejected() == Ids{14, 14});
  REQUIRE(pair.of(EventKind::Ready).size() == 1);
  CHECK(pair.of(EventKind::Ready)[0].missing == Ids{14});
  CHECK(!pair.client.holdings().has(14));
  pair.spoil = nullptr;
  pair.client.land(kMiddle, 4, {});
  pair.settle();
  CHECK(pair.client.transfers().visible() == kToy.within(kMiddle, 4));
}

TEST_CASE("session: a reject that crosses the next landing is made once (6.4, rule 7)") {
  PairOptions options;
  options.lag = 5;
  Pair pair(kToy, options);
  pair.connect();
  int frames = 0;
  pair.spoil = [&frames](EncodedMessage& data) {
    if (frames++ == 0) flip(data);
  };
  pair.client.land({0, 0, 0}, 1, {});
  while (frames == 0) REQUIRE(pair.step());
  pair.client.land({0, 0, 0}, 1, {});
  pair.settle();
  CHECK(pair.rejected().size() == 1);
  CHECK(pair.of(EventKind::Planned).back().plan.keep == Ids{0});
  CHECK(pair.of(EventKind::Ready).back().missing.empty());
  CHECK(pair.holds(0));
}

TEST_CASE("session: an offer names what is held in hello, newest first, or nothing where that was too large") {
  Pair pair(kToy);
  pair.connect();
  pair.client.land(kMiddle, 4, {});
  pair.settle();
  const std::uint32_t newest = pair.received.back();
  pair.disconnect();
  pair.client.connected();
  auto messages = sentMessages(pair.client);
  REQUIRE(messages.size() == 1);
  const HelloMessage hello = std::get<HelloMessage>(messages[0]);
  CHECK(hello.encoding == "glb");
  CHECK(hello.protocol.minorNumber == 0);
  REQUIRE(hello.held.has_value());
  CHECK(hello.held->front().segment == newest);
  CHECK(hello.held->size() == kToy.within(kMiddle, 4).size());
  for (const HeldRow& row : *hello.held) CHECK(row.xxh3 == kToy.facts[row.segment].xxh3);
  pair.client.connected(false);
  messages = sentMessages(pair.client);
  CHECK(std::get<HelloMessage>(messages[0]).held->empty());
}

TEST_CASE("session: an offer goes in as many tables as the server asks for, before the landing") {
  PairOptions options;
  options.maxHeldSegments = 5;
  Pair pair(kToy, options);
  pair.connect();
  pair.client.land(kMiddle, 5, {});
  pair.settle();
  pair.disconnect();
  pair.offersHeld = false;
  pair.client.land(kMiddle, 5, {});
  pair.connect().settle();
  std::vector<std::string> want{"hello"};
  want.insert(want.end(), (kToy.within(kMiddle, 5).size() + 4) / 5, "held");
  want.emplace_back("land");
  REQUIRE(want.size() > 4);
  CHECK(pair.server->heardTypes() == want);
  CHECK(pair.of(EventKind::Planned).back().plan.loadBytes == 0);
  CHECK(pair.client.transfers().repeatedBytes() == 0);
}

TEST_CASE("session: an offer is not made to a server that takes no table; what it does not know of is not held") {
  PairOptions options;
  options.maxHeldSegments = 0;
  Pair pair(kToy, options);
  pair.connect();
  pair.client.land(kMiddle, 4, {});
  pair.settle();
  pair.disconnect();
  pair.offersHeld = false;
  pair.connect().settle();
  CHECK(pair.server->heardTypes() == std::vector<std::string>{"hello"});
  CHECK(pair.of(EventKind::Dropped).back().segments.size() == kToy.within(kMiddle, 4).size());
  CHECK(pair.client.holdings().count() == 0);
  pair.client.land(kMiddle, 4, {});
  pair.settle();
  CHECK(pair.client.transfers().visible() == kToy.within(kMiddle, 4));
  CHECK(pair.client.transfers().repeatedBytes() == 0);
}

TEST_CASE("session: a newer version hides all, drops what changed and keeps the rest (5, rules 3 and 4)") {
  Pair pair(kToy);
  pair.connect();
  pair.client.land(kMiddle, 4, {});
  pair.settle();
  const Ids before = pair.client.transfers().visible();
  pair.disconnect();
  ToyScene newer(900, "v2");
  const Ids changed(before.begin(), before.begin() + 3);
  for (const std::uint32_t segment : changed) {
    newer.replace(segment, std::vector<std::uint8_t>(300, static_cast<std::uint8_t>(segment)));
  }
  pair.scene = &newer;
  pair.received.clear();
  pair.connect().settle();
  const auto opened = pair.of(EventKind::Opened);
  REQUIRE(opened.size() == 2);
  CHECK(!opened[0].changed);
  CHECK(opened[1].changed);
  REQUIRE(pair.of(EventKind::Dropped).size() == 1);
  Ids dropped = pair.of(EventKind::Dropped)[0].segments;
  std::sort(dropped.begin(), dropped.end());
  CHECK(dropped == changed);
  CHECK(pair.client.transfers().visible().empty());
  pair.client.land(kMiddle, 4, {});
  pair.settle();
  CHECK(pair.receivedSorted() == changed);
  CHECK(pair.client.transfers().visible() == before);
}

TEST_CASE("session: picks are answered, and asked again after a lost connection") {
  Pair pair(kToy);
  pair.connect();
  const std::uint32_t first = pair.client.pick({0, 1, 0}, {});
  pair.disconnect();
  const std::uint32_t second = pair.client.pick({0, 1, 0}, Vec3{0, -1, 0});
  CHECK(pair.client.awaitsAnswer());
  pair.connect().settle();
  const auto picked = pair.of(EventKind::Picked);
  REQUIRE(picked.size() == 2);
  CHECK(picked[0].request == first);
  CHECK(picked[1].request == second);
  REQUIRE(picked[0].hit.has_value());
  CHECK(picked[0].hit->segment == 3);
  CHECK(picked[0].hit->heightM == 9);
  CHECK(!picked[0].hit->label.has_value());
  CHECK(!pair.client.awaitsAnswer());
  pair.client.pick({5, 1, 0}, {});
  CHECK(pair.client.dropPicks().size() == 1);
  pair.settle();
  CHECK(pair.of(EventKind::Picked).size() == 2);
}

TEST_CASE("session: picks that are refused are told") {
  PairOptions options;
  options.refusesPicks = true;
  Pair pair(kToy, options);
  pair.connect();
  const std::uint32_t request = pair.client.pick({0, 0, 0}, {});
  pair.settle();
  const auto refused = pair.of(EventKind::PickRefused);
  REQUIRE(refused.size() == 1);
  CHECK(refused[0].request == request);
  CHECK(refused[0].code == "too_many");
  CHECK(pair.of(EventKind::Refused).empty());
}

TEST_CASE("session: news are passed on; groups, and what is not known, are skipped") {
  Pair pair(kToy);
  pair.connect().settle();
  NoticeMessage published;
  published.kind = "scene_published";
  published.version = "v9";
  pair.server->say(published);
  NoticeMessage draining;
  draining.kind = "draining";
  draining.reconnectAfterMs = 1000;
  pair.server->say(draining);
  RosterMessage roster;
  roster.group = "g";
  pair.server->say(roster);
  pair.settle();
  pair.give({"\x81\xa4type\xa3new"});
  pair.give({std::string("\x05\x01\x02\x03", 4)});
  CHECK(pair.violation.isOk());
  const auto notices = pair.of(EventKind::Notice);
  REQUIRE(notices.size() == 2);
  CHECK(notices[0].noticeKind == "scene_published");
  CHECK(notices[0].sceneVersion == "v9");
  CHECK(!notices[0].reconnectAfterMs.has_value());
  CHECK(notices[1].reconnectAfterMs.value_or(0) == 1000);
}
