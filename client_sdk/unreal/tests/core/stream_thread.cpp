// The stream on a thread of its own, over transports in memory.
#include "Terraport/StreamThread.h"
#include "Terraport/Xxh3.h"
#include "stream_fakes.h"

#include <doctest/doctest.h>

#include <chrono>
#include <set>
#include <thread>

using namespace terraport;
using namespace terraport::testing;

TEST_CASE("stream thread: lands, picks and lets go, without a pump of ours") {
  // 1. A landing that is refused, one that is not, and a pick; all are answered on the stream's own thread.
  const auto network = std::make_shared<FakeNetwork>(kStreamToy);
  StreamOptions options;
  options.sceneUrl = "http://example.org/scenes/toy";
  options.cacheBytes = 0;
  auto opened = StreamThread::make(options, std::make_shared<FakeTransports>(network));
  REQUIRE(opened.isOk());
  const std::unique_ptr<StreamThread> stream = opened.take();
  CHECK(stream->land({0, 0, 0}, -1, {}) == kNoLanding);
  const std::int64_t first = stream->land({0, 0, 0}, 2, {});
  CHECK(first == 1);
  const auto pick = stream->pick({0, 1, 0}, {});
  REQUIRE(pick.isOk());
  // 2. Events until the second landing, begun when the first is ready, is ready too. The deadline only ends a test that hangs.
  std::set<std::uint32_t> arrived;
  std::int64_t second = kNoLanding;
  bool isPicked = false;
  bool isRefused = false;
  std::vector<std::uint32_t> visible;
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  while (std::chrono::steady_clock::now() < deadline && visible.empty()) {
    StreamEvent event;
    if (!stream->tryNextEvent(event)) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      continue;
    }
    if (event.kind == EventKind::Arrived) arrived.insert(event.facts.segment);
    if (event.kind == EventKind::Picked) isPicked = event.request == pick.value() && event.hit->segment == 3;
    if (event.kind == EventKind::Refused) isRefused = event.code == "invalid_field";
    if (event.kind == EventKind::Dropped) {
      for (const std::uint32_t segment : event.segments) arrived.erase(segment);
    }
    if (event.kind != EventKind::Ready) continue;
    if (event.landing == first) {
      second = stream->land({10, 0, 10}, 2, {});
    } else {
      CHECK(event.landing == second);
      visible = event.segments;
    }
  }
  // 3. The payloads of what is visible may be read here, from another thread than the one that received them.
  CHECK(visible == kStreamToy.within({10, 0, 10}, 2));
  CHECK(isPicked);
  CHECK(isRefused);
  for (const std::uint32_t segment : visible) {
    REQUIRE(static_cast<bool>(stream->payload(segment)));
    CHECK(*stream->payload(segment) == kStreamToy.payloads[segment]);
  }
  CHECK(stream->stats().payloadBytes > 0);
  // 4. Closing says bye and takes nothing more; what was dropped meanwhile is reported.
  stream->close();
  CHECK(network->server->heardTypes().back() == "bye");
  CHECK(!stream->pick({0, 0, 0}, {}).isOk());
  for (StreamEvent event; stream->tryNextEvent(event);) {
    if (event.kind == EventKind::Dropped) {
      for (const std::uint32_t segment : event.segments) arrived.erase(segment);
    }
  }
  CHECK(arrived == std::set<std::uint32_t>(visible.begin(), visible.end()));
}
