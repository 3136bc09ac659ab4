// An in-memory pair: the client's state machine and the model server, without a socket.
#pragma once

#include "Session.h"
#include "session_model.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace terraport::testing {

struct PairOptions : ModelOptions {
  std::uint64_t cacheBytes = 1 << 20;
  std::uint64_t creditBytes = 4096;
  double releaseFactor = 1;
  Budgets budgets;
  /// Messages of the server that are on their way before one arrives.
  std::size_t lag = 0;
};

inline PairOptions withCredit(std::uint64_t creditBytes) {
  PairOptions options;
  options.creditBytes = creditBytes;
  return options;
}

inline bool isOnce(const std::vector<std::uint32_t>& ids) {
  return std::set<std::uint32_t>(ids.begin(), ids.end()).size() == ids.size();
}

/// One client, over as many connections to one server as it takes.
class Pair {
 public:
  explicit Pair(const ToyScene& toy, PairOptions pairOptions = {})
      : scene(&toy), options(std::move(pairOptions)), client(sessionOptions(options), &toyHash) {}

  const ToyScene* scene;
  const PairOptions options;
  ClientSession client;
  std::unique_ptr<ModelServer> server;
  std::vector<SessionEvent> events;
  /// Ids of segments that came whole, in order.
  std::vector<std::uint32_t> received;
  /// Changes the bytes of a frame on its way.
  std::function<void(EncodedMessage&)> spoil;
  bool offersHeld = true;
  /// What the client found wrong.
  Status violation;

  static SessionOptions sessionOptions(const PairOptions& from) {
    SessionOptions session;
    session.client = "pair";
    session.budgets = from.budgets;
    session.creditBytes = from.creditBytes;
    session.releaseFactor = from.releaseFactor;
    session.cacheBytes = from.cacheBytes;
    return session;
  }

  /// Begin a connection; nothing flows before `step`.
  Pair& connect() {
    server = std::make_unique<ModelServer>(*scene, options);
    client.connected(offersHeld);
    return *this;
  }

  /// Lose the connection with everything that was on its way.
  void disconnect() {
    server.reset();
    down_.clear();
    client.connectionLost();
    collect();
  }

  /// Let one thing happen; whether anything did.
  bool step() {
    collect();
    if (server == nullptr || !violation.isOk()) return false;
    const std::vector<EncodedMessage> sent = client.takeMessages();
    for (const EncodedMessage& message : sent) server->receive(message);
    std::optional<EncodedMessage> data = server->next();
    const bool isAnything = data.has_value() || !sent.empty();
    if (data) {
      const bool isFrame = static_cast<unsigned char>(data->bytes[0]) < 0x80;
      if (isFrame && spoil) spoil(*data);
      down_.push_back(std::move(*data));
    }
    if (down_.size() <= (isAnything ? options.lag : 0)) return isAnything;
    give(down_.front());
    down_.pop_front();
    return true;
  }

  void give(const EncodedMessage& data) {
    violation = client.receive(data.view(), false);
    collect();
  }

  /// Let everything happen that will; `flush` sends aims as the link would.
  void settle(bool flush = false) {
    while (step()) {
      if (flush) client.flushAim();
    }
  }

  std::vector<StreamEvent> of(EventKind kind) const {
    std::vector<StreamEvent> matches;
    for (const SessionEvent& event : events) {
      if (event.news == SessionNews::Stream && event.stream.kind == kind) matches.push_back(event.stream);
    }
    return matches;
  }

  /// Ids of the segments that were rejected, in order.
  std::vector<std::uint32_t> rejected() const {
    std::vector<std::uint32_t> ids;
    for (const SessionEvent& event : events) {
      if (event.news == SessionNews::Rejected) ids.push_back(event.stream.facts.segment);
    }
    return ids;
  }

  std::vector<std::uint32_t> receivedSorted() const {
    std::vector<std::uint32_t> ids = received;
    std::sort(ids.begin(), ids.end());
    return ids;
  }

  bool holds(std::uint32_t segment) const {
    const CachedSegment* const entry = client.holdings().peek(segment);
    return entry != nullptr && *entry->payload == scene->payloads[segment];
  }

 private:
  void collect() {
    for (SessionEvent& event : client.takeEvents()) {
      if (event.news == SessionNews::Stream && event.stream.kind == EventKind::Arrived) {
        received.push_back(event.stream.facts.segment);
      }
      events.push_back(std::move(event));
    }
  }

  std::deque<EncodedMessage> down_;
};

/// Flip a bit of the last byte of a frame.
inline void flip(EncodedMessage& data) {
  data.bytes.back() = static_cast<char>(data.bytes.back() ^ 1);
}

/// Segment id of a frame.
inline std::uint32_t segmentOf(const EncodedMessage& frame) {
  const auto* const bytes = reinterpret_cast<const std::uint8_t*>(frame.bytes.data());
  return bytes[8] | (std::uint32_t{bytes[9]} << 8) | (std::uint32_t{bytes[10]} << 16) | (std::uint32_t{bytes[11]} << 24);
}

}  // namespace terraport::testing
