// What the state machine refuses: of its user, and of its server.
#include "Frames.h"
#include "session_pair.h"

#include <doctest/doctest.h>

#include <limits>

using namespace terraport;
using namespace terraport::testing;

namespace {

EncodedMessage frameOf(std::uint32_t generation, std::uint32_t segment, std::uint32_t offset, std::uint32_t total) {
  static const std::uint8_t byte = 0;
  PayloadFrame frame;
  frame.generation = generation;
  frame.segment = segment;
  frame.offset = offset;
  frame.total = total;
  frame.chunk = {&byte, 1};
  EncodedMessage data;
  REQUIRE(encodeFrame(frame, data.bytes).isOk());
  return data;
}

EncodedMessage messageOf(const ServerMessage& message) {
  EncodedMessage data;
  REQUIRE(encodeMessage(message, data).isOk());
  return data;
}

}  // namespace

TEST_CASE("session: a number that cannot be is refused before anything is sent") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  LandOptions lone;
  lone.deadlineMs = 5;
  LandOptions wide;
  wide.innerRadiusM = 2;
  LandOptions never;
  never.innerRadiusM = 0.5;
  never.deadlineMs = 0;
  CHECK(!checkLand({0, 0, 0}, 0, {}).isOk());
  CHECK(!checkLand({0, 0, 0}, -1, {}).isOk());
  CHECK(!checkLand({0, 0, 0}, nan, {}).isOk());
  CHECK(!checkLand({infinity, 0, 0}, 1, {}).isOk());
  CHECK(!checkLand({0, nan, 0}, 1, {}).isOk());
  CHECK(!checkLand({0, 0, 1.1e7}, 1, {}).isOk());
  CHECK(!checkLand({0, 0, 0}, 1, lone).isOk());
  CHECK(!checkLand({0, 0, 0}, 1, wide).isOk());
  CHECK(!checkLand({0, 0, 0}, 1, never).isOk());
  CHECK(checkLand({0, 0, 0}, 2, wide).isOk());
  CHECK(!checkAim({0, 0, 0}, 0).isOk());
  CHECK(!checkPick({0, 0, 0}, Vec3{0, 0, 0}).isOk());
  CHECK(checkPick({0, 0, 0}, {}).isOk());
  SessionOptions options = Pair::sessionOptions({});
  CHECK(checkSessionOptions(options).isOk());
  options.releaseFactor = 5;
  CHECK(checkSessionOptions(options).code() == "invalid_field");
  options.releaseFactor.reset();
  options.creditBytes = 0;
  CHECK(!checkSessionOptions(options).isOk());
  options.creditBytes = 1;
  options.client = std::string(129, 'x');
  CHECK(!checkSessionOptions(options).isOk());
}

TEST_CASE("session: what the protocol forbids is a violation") {
  WelcomeMessage welcome;
  welcome.protocol = kProtocol;
  welcome.scene.id = "toy";
  welcome.scene.version = "v1";
  welcome.limits = {500, 1 << 20, 60, 1000, 16384, 1 << 20, 60, {}};
  welcome.releaseFactor = 1;
  PrefetchMessage prefetch;
  prefetch.generation = 1;
  ReadyMessage ready;
  ready.generation = 9;
  const std::uint32_t length = kToy.facts[0].length;
  const std::vector<std::pair<std::string, EncodedMessage>> wrongs{
      {"got 0 bytes", EncodedMessage{""}},
      {"0xc1", EncodedMessage{"\xc1"}},
      {"generation 5", frameOf(5, 1, 0, 4)},
      {"does not load", frameOf(1, 35, 0, 4)},
      {"announces", frameOf(1, 0, 0, length + 1)},
      {"continues at byte 1, expected 0", frameOf(1, 0, 1, length)},
      {"second welcome", messageOf(welcome)},
      {"which no aim has", messageOf(prefetch)},
      {"ready of generation 9", messageOf(ready)},
  };
  for (const auto& [text, data] : wrongs) {
    Pair pair(kToy);
    pair.connect().settle();
    pair.client.land({0, 0, 0}, 1, {});
    while (pair.of(EventKind::Planned).empty()) REQUIRE(pair.step());
    pair.give(data);
    CAPTURE(text);
    CHECK(!pair.violation.isOk());
    CHECK_MESSAGE(pair.violation.message().find(text) != std::string::npos, pair.violation.message());
  }
}

TEST_CASE("session: a text message is a violation") {
  Pair pair(kToy);
  pair.connect().settle();
  const Status status = pair.client.receive(EncodedMessage{"{}"}.view(), true);
  CHECK(status.message().find("got a text message, expected a binary one") != std::string::npos);
}

TEST_CASE("session: a plan before the welcome, twice, beyond the budgets or with what was never held is a violation") {
  Pair pair(kToy);
  pair.connect().settle();
  pair.client.land(kMiddle, 1, {});
  for (const EncodedMessage& data : pair.client.takeMessages()) pair.server->receive(data);
  const EncodedMessage plan = *pair.server->next();
  Pair other(kToy);
  other.client.connected();
  other.give(plan);
  CHECK(other.violation.message().find("plan first") != std::string::npos);
  pair.give(plan);
  CHECK(pair.violation.isOk());
  pair.give(plan);
  CHECK(pair.violation.message().find("plan of generation 1") != std::string::npos);

  PairOptions small;
  small.budgets.maxBytes = kToy.bytesOf(kToy.within(kMiddle, 1)) - 1;
  Pair bounded(kToy, small);
  bounded.connect().settle();
  bounded.client.land(kMiddle, 1, {});
  bounded.give(plan);
  CHECK(bounded.violation.message().find("budgets") != std::string::npos);

  Pair keeps(kToy);
  keeps.connect().settle();
  keeps.server->held[7] = kToy.facts[7].xxh3;
  keeps.client.land({2, 0, 2}, 1, {});
  keeps.settle();
  CHECK(keeps.violation.message().find("keeps segment 7, which was never held") != std::string::npos);
}

TEST_CASE("session: a server that sends the same wrong bytes for ever is left") {
  Pair pair(kToy);
  pair.connect().settle();
  pair.client.land({0, 0, 0}, 0.5, {});
  while (pair.of(EventKind::Planned).empty()) REQUIRE(pair.step());
  EncodedMessage frame = *pair.server->next();
  flip(frame);
  for (int copy = 0; copy < 2; ++copy) {
    pair.give(frame);
    CHECK(pair.violation.isOk());
  }
  pair.give(frame);
  CHECK(!pair.violation.isOk());
  CHECK(pair.client.takeMessages().size() <= 3);
}
