// The stream over transports in memory: connecting, aims, waits, and its events.
#include "Terraport/SceneStream.h"
#include "Terraport/StreamThread.h"
#include "Terraport/Xxh3.h"
#include "stream_fakes.h"

#include <doctest/doctest.h>

#include <limits>

using namespace terraport;
using namespace terraport::testing;

namespace {

/// One stream with its network and a clock that the test moves.
struct Setting {
  std::shared_ptr<FakeNetwork> network;
  std::unique_ptr<SceneStream> stream;
  double nowMs = 1000;
  std::vector<StreamEvent> events;

  explicit Setting(StreamOptions options = {}) {
    network = std::make_shared<FakeNetwork>(kStreamToy);
    options.sceneUrl = "http://example.org/scenes/toy";
    auto opened = SceneStream::make(options, std::make_shared<FakeTransports>(network), [] { return 0.0; });
    REQUIRE(opened.isOk());
    stream = opened.take();
  }

  /// Pump until `forMs` have passed.
  void run(double forMs, double everyMs = 5) {
    for (const double endMs = nowMs + forMs; nowMs < endMs; nowMs += everyMs) {
      stream->pump(nowMs);
      take();
    }
  }

  void take() {
    for (StreamEvent event; stream->tryNextEvent(event); event = StreamEvent()) events.push_back(event);
  }

  std::vector<StreamEvent> of(EventKind kind) const {
    std::vector<StreamEvent> matches;
    for (const StreamEvent& event : events) {
      if (event.kind == kind) matches.push_back(event);
    }
    return matches;
  }

  LinkState link() const { return of(EventKind::Link).back().link; }

  std::size_t heardAims() const {
    const auto types = network->server->heardTypes();
    return static_cast<std::size_t>(std::count(types.begin(), types.end(), "aim"));
  }
};

ErrorMessage fatal(const char* code) {
  ErrorMessage error;
  error.code = code;
  error.message = "because";
  error.fatal = true;
  return error;
}

}  // namespace

TEST_CASE("stream: lands, and tells what a stage needs") {
  StreamOptions options;
  options.token = "secret";
  Setting setting(options);
  const std::int64_t landing = setting.stream->land(kMiddle, 4, {});
  setting.run(100);
  CHECK(setting.network->url == "ws://example.org/scenes/toy/stream");
  CHECK(setting.network->token == "secret");
  CHECK(setting.network->subprotocols == std::vector<std::string>{kSubprotocol});
  const auto links = setting.of(EventKind::Link);
  REQUIRE(links.size() == 2);
  CHECK(links[0].link.phase == LinkPhase::Connecting);
  CHECK(links[1].link.phase == LinkPhase::Open);
  const auto opened = setting.of(EventKind::Opened);
  REQUIRE(opened.size() == 1);
  CHECK(opened[0].sceneVersion == "v1");
  CHECK(opened[0].maxRadiusM == 500);
  const auto planned = setting.of(EventKind::Planned);
  REQUIRE(planned.size() == 1);
  CHECK(planned[0].plan.landing == landing);
  CHECK(planned[0].plan.effectiveRadiusM == 4);
  const std::vector<std::uint32_t> want = kStreamToy.within(kMiddle, 4);
  CHECK(setting.of(EventKind::Arrived).size() == want.size());
  const auto ready = setting.of(EventKind::Ready);
  REQUIRE(ready.size() == 1);
  CHECK(ready[0].landing == landing);
  CHECK(ready[0].segments == want);
  CHECK(ready[0].elapsedMs >= 0);
  CHECK(ready[0].payloadBytes == kStreamToy.bytesOf(want));
  for (const std::uint32_t segment : want) {
    const SharedPayload payload = setting.stream->payload(segment);
    REQUIRE(static_cast<bool>(payload));
    CHECK(*payload == kStreamToy.payloads[segment]);
  }
  CHECK(!setting.stream->payload(35));
  CHECK(setting.stream->stats().heldSegments == want.size());
  CHECK(setting.stream->stats().heldBytes == kStreamToy.bytesOf(want));
}

TEST_CASE("stream: options that cannot be are refused") {
  const auto network = std::make_shared<FakeNetwork>(kStreamToy);
  const auto transports = std::make_shared<FakeTransports>(network);
  StreamOptions options;
  options.sceneUrl = "ftp://x/scenes/y";
  CHECK(SceneStream::make(options, transports).status().code() == "invalid_url");
  options.sceneUrl = "http://x";
  CHECK(SceneStream::make(options, transports).status().code() == "invalid_url");
  options.sceneUrl = "http://x/scenes/y";
  CHECK(!SceneStream::make(options, nullptr).isOk());
  options.creditBytes = 0;
  CHECK(SceneStream::make(options, transports).status().code() == "invalid_field");
  CHECK(StreamThread::make(options, transports).status().code() == "invalid_field");
}

TEST_CASE("stream: a number that cannot be is told, and changes nothing") {
  Setting setting;
  setting.run(20);
  CHECK(setting.stream->land({0, 0, 0}, std::numeric_limits<double>::quiet_NaN(), {}) == kNoLanding);
  setting.stream->aim({0, 0, 0}, -1);
  CHECK(!setting.stream->pick({0, 0, 0}, Vec3{0, 0, 0}).isOk());
  setting.run(20);
  const auto refused = setting.of(EventKind::Refused);
  REQUIRE(refused.size() == 2);
  CHECK(refused[0].code == "invalid_field");
  CHECK(refused[0].landing == kNoLanding);
  CHECK(setting.network->server->heardTypes() == std::vector<std::string>{"hello"});
  CHECK(setting.stream->land(kMiddle, 1, {}) == 1);
}

TEST_CASE("stream: aims go out at most ten times a second, the newest of them") {
  Setting setting;
  setting.run(20);
  for (int step = 0; step < 200; ++step) {
    setting.stream->aim({step / 100.0, 0, 0}, 0.5);
    setting.run(5);
  }
  CHECK(setting.heardAims() >= 9);
  CHECK(setting.heardAims() <= 11);
}

TEST_CASE("stream: speaks no faster than the server allows, and lands last what was asked last") {
  Setting setting;
  setting.run(20);
  // 60 messages a second over 10 s allow 480 at once, by our margin.
  for (int step = 0; step < 3000; ++step) {
    setting.stream->land(kMiddle, 1 + (step % 7) / 7.0, {});
    setting.run(1, 1);
  }
  const std::size_t heard = setting.network->server->heard.size();
  CHECK(heard < 480 + 3 * 48 + 10);
  CHECK(heard > 300);
  const std::int64_t last = setting.stream->land(kMiddle, 4, {});
  setting.run(2000);
  CHECK(setting.of(EventKind::Ready).back().landing == last);
  CHECK(setting.of(EventKind::Ready).back().segments == kStreamToy.within(kMiddle, 4));
}

TEST_CASE("stream: a cut connection is made again after the wait, and no segment comes twice") {
  StreamOptions options;
  options.creditBytes = 500;
  Setting setting(options);
  const std::int64_t landing = setting.stream->land(kMiddle, 4, {});
  setting.run(10);
  setting.network->isSilent = true;
  setting.run(10);
  setting.network->breaksWith = 1006;
  setting.run(10);
  LinkState link = setting.link();
  CHECK(link.phase == LinkPhase::Waiting);
  CHECK(link.retryInMs == 250);
  CHECK(link.closeCode == 1006);
  CHECK(link.code == "closed");
  CHECK(link.attempt == 2);
  setting.network->isSilent = false;
  setting.run(235);
  CHECK(setting.network->opened == 1);
  setting.run(300);
  CHECK(setting.network->opened == 2);
  CHECK(setting.of(EventKind::Ready).back().landing == landing);
  CHECK(setting.of(EventKind::Ready).back().segments == kStreamToy.within(kMiddle, 4));
  CHECK(setting.stream->stats().repeatedBytes == 0);
  CHECK(setting.of(EventKind::Arrived).size() == kStreamToy.within(kMiddle, 4).size());
}

TEST_CASE("stream: waits double while the server is away, and are cut short by reconnect") {
  Setting setting;
  setting.network->isDown = true;
  setting.run(4000);
  std::vector<double> waits;
  for (const StreamEvent& event : setting.of(EventKind::Link)) {
    if (event.link.phase == LinkPhase::Waiting) waits.push_back(event.link.retryInMs);
  }
  CHECK(waits == std::vector<double>{250, 500, 1000, 2000, 4000});
  setting.network->isDown = false;
  setting.stream->reconnect("");
  setting.run(50);
  CHECK(setting.link().phase == LinkPhase::Open);
}

TEST_CASE("stream: is closed for good where the server says so, and tells whoever waits") {
  Setting setting;
  setting.network->closesWith = 4404;
  setting.network->says = fatal("unknown_scene");
  const auto pick = setting.stream->pick({0, 0, 0}, {});
  REQUIRE(pick.isOk());
  setting.run(50);
  LinkState link = setting.link();
  CHECK(link.phase == LinkPhase::Closed);
  CHECK(link.closeCode == 4404);
  CHECK(link.code == "unknown_scene");
  CHECK(link.message == "because");
  const auto refused = setting.of(EventKind::PickRefused);
  REQUIRE(refused.size() == 1);
  CHECK(refused[0].request == pick.value());
  CHECK(setting.stream->pick({0, 0, 0}, {}).status().code() == "unknown_scene");
  setting.run(60000, 100);
  CHECK(setting.network->opened == 1);
  setting.network->closesWith = 4401;
  setting.network->says.reset();
  setting.stream->reconnect("");
  setting.run(50);
  CHECK(setting.link().code == "unauthorised");
  setting.network->closesWith = 0;
  setting.stream->land(kMiddle, 1, {});
  setting.stream->reconnect("newer");
  setting.run(50);
  CHECK(setting.network->token == "newer");
  CHECK(setting.of(EventKind::Ready).size() == 1);
  setting.stream->reconnect("newest");
  setting.run(50);
  CHECK(setting.network->token == "newest");
  CHECK(setting.network->opened == 4);
}

TEST_CASE("stream: a function gives each connection its token, and a refused one may be renewed") {
  std::string present = "first";
  int asked = 0;
  StreamOptions options;
  options.tokenProvider = [&present, &asked] {
    asked += 1;
    return present;
  };
  Setting setting(options);
  setting.stream->land(kMiddle, 4, {});
  setting.run(50);
  CHECK(setting.network->token == "first");
  CHECK(asked == 1);
  // It ends: there is another by now, so it is waited for as after any loss, and nothing comes twice.
  present = "second";
  const std::size_t arrived = setting.of(EventKind::Arrived).size();
  setting.network->breaksWith = 4401;
  setting.run(10);
  CHECK(setting.link().phase == LinkPhase::Waiting);
  CHECK(setting.link().code == "unauthorised");
  setting.run(500);
  CHECK(setting.network->token == "second");
  CHECK(setting.link().phase == LinkPhase::Open);
  setting.stream->land(kMiddle, 4, {});
  setting.run(50);
  CHECK(setting.of(EventKind::Ready).size() == 2);
  CHECK(setting.of(EventKind::Arrived).size() == arrived);
  // The same again is no other: closed for good.
  setting.network->breaksWith = 4401;
  setting.run(60000, 100);
  CHECK(setting.link().phase == LinkPhase::Closed);
  CHECK(setting.network->opened == 2);
  // Whoever gives one by hand is not overruled.
  setting.stream->reconnect("by hand");
  setting.run(50);
  CHECK(setting.network->token == "by hand");
  CHECK(setting.link().phase == LinkPhase::Open);
}

TEST_CASE("stream: a service that never knew the token is not asked again, whatever the function gives") {
  int asked = 0;
  StreamOptions options;
  options.tokenProvider = [&asked] { return std::to_string(++asked); };
  Setting setting(options);
  setting.network->closesWith = 4401;
  setting.run(60000, 100);
  CHECK(setting.network->opened == 1);
  CHECK(asked == 1);
  CHECK(setting.link().phase == LinkPhase::Closed);
}

TEST_CASE("stream: a server that breaks the protocol is left with 4400") {
  Setting setting;
  setting.run(20);
  ReadyMessage ready;
  ready.generation = 9;
  setting.network->server->say(ready);
  setting.run(20);
  CHECK(setting.network->clientCode == 4400);
  CHECK(setting.link().phase == LinkPhase::Closed);
  CHECK(setting.link().code == "malformed");
  CHECK(setting.link().message.find("ready of generation 9") != std::string::npos);
}

TEST_CASE("stream: a subprotocol that was not offered is none") {
  Setting setting;
  setting.network->chosen = "terraport.v2.msgpack";
  setting.run(20);
  CHECK(setting.link().phase == LinkPhase::Closed);
  CHECK(setting.network->clientCode == 4400);
}

TEST_CASE("stream: silence ends a connection where the server owes an answer, and no welcome does") {
  Setting setting;
  setting.network->isSilent = true;
  setting.run(10200, 50);
  CHECK(setting.link().phase == LinkPhase::Waiting);
  CHECK(setting.link().code == "timeout");
  setting.network->isSilent = false;
  setting.run(1000);
  CHECK(setting.link().phase == LinkPhase::Open);
  setting.network->isSilent = true;
  setting.run(60000, 100);
  CHECK(setting.link().phase == LinkPhase::Open);
  setting.stream->land(kMiddle, 1, {});
  setting.run(29000, 100);
  CHECK(setting.link().phase == LinkPhase::Open);
  setting.run(1500, 100);
  LinkState lost;
  for (const StreamEvent& event : setting.of(EventKind::Link)) {
    if (event.link.phase == LinkPhase::Waiting) lost = event.link;
  }
  CHECK(lost.message == "the server is silent");
  CHECK(lost.closeCode == 4408);
}

TEST_CASE("stream: an offer that is too large for hello is made after the welcome, at once") {
  Setting setting;
  setting.stream->land(kMiddle, 4, {});
  setting.run(50);
  setting.network->closesWith = 4413;
  setting.network->says = fatal("too_large");
  setting.network->breaksWith = 1006;
  setting.run(300);
  // Once more, without the offer; then it is given up.
  CHECK(setting.network->opened == 3);
  CHECK(setting.link().phase == LinkPhase::Closed);
  setting.network->closesWith = 0;
  setting.network->says.reset();
  setting.stream->land(kMiddle, 4, {});
  setting.stream->reconnect("");
  setting.run(50);
  CHECK(setting.of(EventKind::Planned).back().plan.loadBytes == 0);
  CHECK(setting.network->server->heardTypes()[1] == "held");
}

TEST_CASE("stream: a notice replaces the first wait") {
  Setting setting;
  setting.run(20);
  NoticeMessage notice;
  notice.kind = "draining";
  notice.reconnectAfterMs = 7777;
  setting.network->server->say(notice);
  setting.run(20);
  CHECK(setting.of(EventKind::Notice).size() == 1);
  setting.network->breaksWith = 4503;
  setting.run(20);
  CHECK(setting.link().retryInMs == 7777);
  CHECK(setting.link().code == "draining");
}

TEST_CASE("stream: takes nothing more where nobody takes its events, and at most so many bytes in a pump") {
  Setting setting;
  setting.run(20);
  NoticeMessage notice;
  notice.kind = "scene_published";
  for (int count = 0; count < 10000; ++count) setting.network->server->say(notice);
  for (int pump = 0; pump < 20; ++pump) setting.stream->pump(setting.nowMs);
  std::size_t waiting = 0;
  for (StreamEvent event; setting.stream->tryNextEvent(event);) waiting += 1;
  CHECK(waiting == 8192);
  setting.stream->setMaxPumpBytes(100);
  setting.stream->pump(setting.nowMs);
  waiting = 0;
  for (StreamEvent event; setting.stream->tryNextEvent(event);) waiting += 1;
  CHECK(waiting > 0);
  CHECK(waiting < 10);
}

TEST_CASE("stream: at most 64 picks wait; what a full buffer holds back goes later") {
  Setting setting;
  setting.run(20);
  setting.network->isFull = true;
  for (int count = 0; count < 64; ++count) REQUIRE(setting.stream->pick({0, 0, 0}, {}).isOk());
  CHECK(setting.stream->pick({0, 0, 0}, {}).status().code() == "too_many");
  setting.run(50);
  CHECK(setting.of(EventKind::Picked).empty());
  setting.network->isFull = false;
  setting.run(50);
  CHECK(setting.of(EventKind::Picked).size() == 64);
  CHECK(setting.of(EventKind::Picked)[0].hit->segment == 3);
}

TEST_CASE("stream: close says goodbye, keeps what is held, and is the end") {
  Setting setting;
  setting.stream->land(kMiddle, 1, {});
  setting.run(50);
  setting.stream->close();
  CHECK(setting.network->server->heardTypes().back() == "bye");
  CHECK(setting.network->clientCode == 1000);
  CHECK(static_cast<bool>(setting.stream->payload(kStreamToy.within(kMiddle, 1)[0])));
  setting.stream->reconnect("x");
  setting.run(1000);
  CHECK(setting.network->opened == 1);
  CHECK(setting.stream->pick({0, 0, 0}, {}).status().code() == "closed");
}
