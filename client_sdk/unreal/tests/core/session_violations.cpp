// What the state machine refuses, beside what the session corpus has of it: options, and what a server would send for ever.
#include "Frames.h"
#include "Session.h"
#include "stream_server.h"

#include <doctest/doctest.h>

using namespace terraport;
using namespace terraport::testing;

namespace {

const ToyScene kToy;

EncodedMessage messageOf(const ServerMessage& message) {
  EncodedMessage data;
  REQUIRE(encodeMessage(message, data).isOk());
  return data;
}

SessionOptions sessionOptions() {
  SessionOptions options;
  options.client = "t";
  options.creditBytes = options.cacheBytes = 1 << 20;
  return options;
}

/// A session that has landed, and all that the server says to it; the welcome is taken.
struct Landed {
  ClientSession session;
  AnsweringServer server{kToy};
  std::vector<EncodedMessage> said;

  explicit Landed(SessionOptions options = sessionOptions()) : session(std::move(options), &xxh3Hash64) {
    session.connected();
    hear();
    REQUIRE(give(said[0]).isOk());
    session.land({0, 0, 0}, 0.5, {});
    said.clear();
    hear();
  }

  void hear() {
    for (const EncodedMessage& message : session.takeMessages()) server.receive(message);
    while (const std::optional<EncodedMessage> data = server.next()) said.push_back(*data);
  }

  Status give(const EncodedMessage& data) { return session.receive(data.view(), false); }
};

}  // namespace

TEST_CASE("session: options and numbers that cannot be are refused") {
  LandOptions never;
  never.innerRadiusM = 0.5;
  never.deadlineMs = 0;
  CHECK(!checkLand({0, 0, 1.1e7}, 1, {}).isOk());
  CHECK(!checkLand({0, 0, 0}, 1, never).isOk());
  SessionOptions options = sessionOptions();
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

TEST_CASE("session: a prefetch of no aim, and a plan beyond the budgets, are violations") {
  Landed landed;
  PrefetchMessage prefetch;
  prefetch.generation = 1;
  CHECK(landed.give(messageOf(prefetch)).message().find("which no aim has") != std::string::npos);
  SessionOptions small = sessionOptions();
  small.budgets.maxBytes = kToy.payloads[0].size() - 1;
  Landed bounded(small);
  CHECK(bounded.give(bounded.said[0]).message().find("budgets") != std::string::npos);
  SessionOptions shared = sessionOptions();
  shared.budgets.maxGpuBytes = 1000;
  for (const std::uint64_t gpuBytes : {1000, 1001}) {
    Landed drawn(shared);
    PlanMessage plan;
    plan.generation = 1;
    plan.radiusM = plan.releaseRadiusM = plan.effectiveRadiusM = 1.0;
    plan.totalGpuBytes = gpuBytes;
    CHECK(drawn.give(messageOf(plan)).isOk() == (gpuBytes == 1000));
  }
}

TEST_CASE("session: a server that sends the same wrong bytes for ever is left") {
  Landed landed;
  REQUIRE(landed.give(landed.said[0]).isOk());
  EncodedMessage frame = landed.said[1];
  frame.bytes.back() = static_cast<char>(frame.bytes.back() ^ 1);
  CHECK(landed.give(frame).isOk());
  CHECK(landed.give(frame).isOk());
  CHECK(!landed.give(frame).isOk());
  CHECK(landed.session.takeMessages().size() <= 3);
}
