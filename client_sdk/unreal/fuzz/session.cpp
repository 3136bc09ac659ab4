// A whole life of a ClientSession: the bytes are a list of what its user does, what its connection does, and what a server
// says, rightly or wrongly. The server's messages are made so that most get past the first checks, or taken as they are.
#include "Session.h"
#include "Bytes.h"
#include "Frames.h"
#include "WireCodec.h"

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <set>
#include <vector>

using namespace terraport;

namespace {

constexpr std::uint64_t kCacheBytes = 300;
constexpr std::uint64_t kMaxBytes = 2000;

void expect(bool isTrue) {
  if (!isTrue) std::abort();
}

/// Stands in for XXH3, so that right payloads are found by chance: the sum of the bytes.
std::uint64_t sumOf(ByteSpan bytes) {
  std::uint64_t sum = 0;
  for (std::size_t at = 0; at < bytes.size; ++at) sum += bytes.data[at];
  return sum;
}

/// Numbers out of the input; 0 where it has ended.
class Input {
 public:
  Input(const std::uint8_t* data, std::size_t size) : at_(data), end_(data + size) {}

  bool isOver() const { return at_ == end_; }
  std::uint8_t byte() { return isOver() ? 0 : *at_++; }
  std::uint32_t below(std::uint32_t most) { return byte() % most; }

  ByteSpan bytes(std::size_t most) {
    const std::size_t size = std::min<std::size_t>(most, static_cast<std::size_t>(end_ - at_));
    const ByteSpan slice{at_, size};
    at_ += size;
    return slice;
  }

 private:
  const std::uint8_t* at_;
  const std::uint8_t* end_;
};

class Life {
 public:
  explicit Life(Input& input) : input_(input), session_(optionsOf(), &sumOf) {}

  void live() {
    while (!input_.isOver()) {
      act();
      look();
    }
    session_.connectionLost();
    look();
    expect(session_.transfers().partialSegments() == 0);
  }

 private:
  static SessionOptions optionsOf() {
    SessionOptions options;
    options.client = "fuzz";
    options.creditBytes = 64;
    options.cacheBytes = kCacheBytes;
    options.budgets.maxBytes = kMaxBytes;
    options.budgets.maxSegments = 12;
    return options;
  }

  /// One step of either side. Frames are drawn most often: they have the most to go wrong.
  void act() {
    switch (input_.below(20)) {
      // 1. The application and the connection.
      case 0:
        session_.connected(input_.below(2) != 0);
        break;
      case 1:
        session_.connectionLost();
        break;
      case 2:
      case 3:
        session_.land({1, 2, 3}, 10, {});
        break;
      case 4:
        session_.aim({1, 2, 3}, 10);
        session_.flushAim();
        break;
      case 5:
        session_.pick({0, 0, 0}, {});
        break;
      case 6:
        readMessages();
        break;
      // 2. The server, right or wrong.
      case 7:
        say(welcome());
        break;
      case 8:
      case 9:
        say(plan());
        break;
      case 10:
        say(prefetch());
        break;
      case 11:
      case 12:
      case 13:
      case 14:
        frame();
        break;
      case 15:
        say(ready());
        break;
      case 16:
        say(degraded());
        break;
      case 17:
        say(superseded());
        break;
      case 18:
        say(error());
        break;
      default:
        raw();
    }
  }

  /// What holds whatever the server says.
  void look() {
    for (const SessionEvent& event : session_.takeEvents()) {
      if (event.news != SessionNews::Stream) continue;
      const StreamEvent& streamEvent = event.stream;
      if (streamEvent.kind == EventKind::Arrived) arrived_.insert(streamEvent.facts.segment);
      if (streamEvent.kind == EventKind::Dropped) {
        for (const std::uint32_t segment : streamEvent.segments) arrived_.erase(segment);
      }
      if (streamEvent.kind == EventKind::Ready) {
        expect(std::is_sorted(streamEvent.segments.begin(), streamEvent.segments.end()));
        expect(ended_.insert(streamEvent.landing).second);
      }
      if (streamEvent.kind == EventKind::Superseded) expect(ended_.insert(streamEvent.landing).second);
    }
    // What was reported as arrived and not as dropped is held, and nothing else.
    expect(arrived_.size() == session_.holdings().count());
    for (const std::uint32_t segment : arrived_) expect(session_.holdings().has(segment));
    // Pins may exceed the cache: what is shown, an inner set and a plan; what an aim brings while a plan is owed comes beside.
    expect(session_.holdings().bytes() <= kCacheBytes + 4 * kMaxBytes * (1 + aims_));
    expect(session_.transfers().partialSegments() <= 16384);
  }

  void readMessages() {
    MessageReader reader;
    for (const EncodedMessage& data : session_.takeMessages()) {
      ClientMessage message;
      DecodeError wrong;
      expect(reader.read(data.view(), message, wrong));
      if (const auto* const land = std::get_if<LandMessage>(&message)) newest_ = land->generation;
      if (const auto* const aim = std::get_if<AimMessage>(&message)) {
        newest_ = aim->generation;
        aims_ += 1;
      }
    }
  }

  void say(const ServerMessage& message) {
    EncodedMessage data;
    if (encodeMessage(message, data).isOk()) give(data.view(), false);
  }

  void give(ByteSpan data, bool isText) {
    if (session_.receive(data, isText).isOk()) return;
    // As the link does it.
    session_.connectionLost();
  }

  std::uint32_t generation() { return newest_ - std::min(newest_, input_.below(3)); }

  SegmentFacts facts() {
    SegmentFacts row;
    row.segment = input_.below(10);
    row.length = 1 + input_.below(200);
    row.xxh3 = input_.byte();
    row.faces = 1;
    row.vertices = 3;
    return row;
  }

  std::vector<SegmentFacts> rows() {
    std::vector<SegmentFacts> rowsOfMessage;
    std::set<std::uint32_t> ids;
    for (std::uint32_t count = input_.below(6); count > 0; --count) {
      const SegmentFacts row = facts();
      if (ids.insert(row.segment).second) rowsOfMessage.push_back(row);
    }
    last_ = rowsOfMessage;
    return rowsOfMessage;
  }

  std::vector<std::uint32_t> ids() {
    std::set<std::uint32_t> ids;
    for (std::uint32_t count = input_.below(4); count > 0; --count) ids.insert(input_.below(10));
    return {ids.begin(), ids.end()};
  }

  ServerMessage welcome() {
    WelcomeMessage message;
    message.protocol = {1, input_.below(2)};
    message.scene.id = "s";
    message.scene.version = input_.below(4) != 0 ? "a" : "b";
    message.scene.segmentCount = 10;
    message.limits.maxRadiusM = 100;
    message.limits.maxMessageBytes = 70 + 10 * input_.below(20);
    message.limits.maxMessagesPerS = 10;
    message.limits.maxHeldSegments = input_.below(5);
    message.limits.maxPlanSegments = 100;
    message.limits.maxCreditBytes = 1 + input_.byte();
    message.limits.idleTimeoutS = 1;
    message.releaseFactor = 1;
    message.dropped = ids();
    return message;
  }

  ServerMessage plan() {
    PlanMessage message;
    message.generation = generation();
    message.radiusM = 10;
    message.releaseRadiusM = 10;
    message.effectiveRadiusM = 10;
    message.load = rows();
    for (const SegmentFacts& row : message.load) {
      message.loadBytes += row.length;
      message.loadTriangles += row.faces;
    }
    for (const std::uint32_t segment : ids()) {
      const bool isLoaded = std::any_of(
          message.load.begin(), message.load.end(), [segment](const SegmentFacts& row) { return row.segment == segment; });
      if (!isLoaded && (arrived_.count(segment) != 0 || input_.below(8) == 0)) message.keep.push_back(segment);
    }
    message.totalBytes = message.loadBytes;
    message.totalTriangles = message.loadTriangles;
    return message;
  }

  ServerMessage prefetch() {
    PrefetchMessage message;
    message.generation = generation();
    message.segments = rows();
    for (const SegmentFacts& row : message.segments) message.bytes += row.length;
    return message;
  }

  ServerMessage ready() {
    ReadyMessage message;
    message.generation = generation();
    message.missing = ids();
    return message;
  }

  ServerMessage degraded() {
    DegradedMessage message;
    message.generation = generation();
    message.segments = ids();
    return message;
  }

  ServerMessage superseded() {
    SupersededMessage message;
    message.generation = generation();
    message.by = newest_;
    return message;
  }

  ServerMessage error() {
    ErrorMessage message;
    message.code = "internal";
    message.fatal = input_.below(4) == 0;
    if (input_.below(2) != 0) message.generation = generation();
    if (input_.below(2) != 0) message.request = input_.below(4);
    return message;
  }

  /// A whole segment of the newest list with the sum that it should have, or a chunk of any.
  void frame() {
    PayloadFrame next;
    next.generation = generation();
    std::vector<std::uint8_t> payload;
    if (!last_.empty() && input_.below(4) != 0) {
      const SegmentFacts& row = last_[input_.below(static_cast<std::uint32_t>(last_.size()))];
      payload.assign(row.length, 0);
      payload[0] = static_cast<std::uint8_t>(row.xxh3);
      next.segment = row.segment;
      next.total = row.length;
      const std::size_t cut = 1 + input_.below(static_cast<std::uint32_t>(payload.size()));
      std::string data;
      next.chunk = {payload.data(), cut};
      if (encodeFrame(next, data).isOk()) give(spanOf(data), false);
      if (cut == payload.size() || input_.below(4) == 0) return;
      next.offset = static_cast<std::uint32_t>(cut);
      next.chunk = {payload.data() + cut, payload.size() - cut};
      if (encodeFrame(next, data).isOk()) give(spanOf(data), false);
      return;
    }
    next.segment = input_.below(10);
    next.offset = input_.below(4);
    next.chunk = input_.bytes(1 + input_.below(30));
    next.total = next.offset + static_cast<std::uint32_t>(next.chunk.size) + input_.below(3);
    std::string data;
    if (encodeFrame(next, data).isOk()) give(spanOf(data), false);
  }

  void raw() {
    const bool isText = input_.below(2) != 0;
    give(input_.bytes(input_.byte()), isText);
  }

  static ByteSpan spanOf(const std::string& data) { return {reinterpret_cast<const std::uint8_t*>(data.data()), data.size()}; }

  Input& input_;
  ClientSession session_;
  std::set<std::uint32_t> arrived_;
  std::set<std::int64_t> ended_;
  std::vector<SegmentFacts> last_;
  std::uint32_t newest_ = 0;
  std::uint64_t aims_ = 0;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Input input(data, size);
  Life(input).live();
  return 0;
}
