// The other end of a stream: a server that answers what it is asked, one landing at a time, and no more. How a session behaves
// is shown by the session corpus, which the real server's state machine made; tests of the stream need somebody who answers
// at a time that they choose.
#pragma once

#include "Frames.h"
#include "WireCodec.h"
#include "stream_toy.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cstdint>
#include <deque>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace terraport::testing {

/// One connection.
class AnsweringServer {
 public:
  explicit AnsweringServer(const ToyScene& scene) : scene_(scene) {}

  /// Everything that the client said, in order.
  std::vector<ClientMessage> heard;

  void say(ServerMessage message) { out_.push_back(std::move(message)); }

  void receive(const EncodedMessage& data) {
    ClientMessage message;
    DecodeError error;
    REQUIRE_MESSAGE(reader_.read(data.view(), message, error), error.message);
    heard.push_back(message);
    if (const auto* const hello = std::get_if<HelloMessage>(&message)) welcome(*hello);
    if (const auto* const held = std::get_if<HeldMessage>(&message)) hold(held->segments);
    if (const auto* const credit = std::get_if<CreditMessage>(&message)) credit_ += credit->bytes;
    if (const auto* const land = std::get_if<LandMessage>(&message)) plan(*land);
    if (const auto* const pick = std::get_if<PickMessage>(&message)) answer(*pick);
    if (const auto* const evict = std::get_if<EvictMessage>(&message)) {
      for (const std::uint32_t segment : evict->segments) held_.erase(segment);
    }
  }

  /// The next WebSocket message; absent where nothing is to be said.
  std::optional<EncodedMessage> next() {
    EncodedMessage data;
    if (out_.empty() && landing_ && load_.empty()) {
      ReadyMessage ready;
      ready.generation = *std::exchange(landing_, std::nullopt);
      say(ready);
    }
    if (!out_.empty()) {
      REQUIRE(encodeMessage(out_.front(), data).isOk());
      out_.pop_front();
      return data;
    }
    if (!landing_ || credit_ == 0) return std::nullopt;
    const std::vector<std::uint8_t>& payload = scene_.payloads[load_.front()];
    const std::size_t length = std::min<std::size_t>(payload.size() - sentBytes_, credit_);
    PayloadFrame frame;
    frame.generation = *landing_;
    frame.segment = load_.front();
    frame.offset = static_cast<std::uint32_t>(sentBytes_);
    frame.total = static_cast<std::uint32_t>(payload.size());
    frame.chunk = {payload.data() + sentBytes_, length};
    REQUIRE(encodeFrame(frame, data.bytes).isOk());
    credit_ -= length;
    sentBytes_ += length;
    if (sentBytes_ == payload.size()) {
      held_.insert(load_.front());
      load_.pop_front();
      sentBytes_ = 0;
    }
    return data;
  }

  /// Types of what was heard, for comparing.
  std::vector<std::string> heardTypes() const {
    std::vector<std::string> types;
    for (const ClientMessage& message : heard) types.emplace_back(typeOf(message));
    return types;
  }

 private:
  void hold(const std::vector<HeldRow>& rows) {
    for (const HeldRow& row : rows) held_.insert(row.segment);
  }

  void welcome(const HelloMessage& hello) {
    credit_ = hello.creditBytes;
    if (hello.held) hold(*hello.held);
    WelcomeMessage message;
    message.protocol = kProtocol;
    message.server = "answering";
    message.session = "s";
    message.scene.id = "toy";
    message.scene.version = scene_.version;
    message.scene.name = "toy";
    message.scene.segmentCount = static_cast<std::uint32_t>(scene_.facts.size());
    message.limits = {500, 1 << 20, 60, 1000, 16384, 1 << 26, 60, {}};
    message.releaseFactor = 1;
    message.heldCount = static_cast<std::uint32_t>(held_.size());
    say(std::move(message));
  }

  void plan(const LandMessage& land) {
    if (landing_) {
      SupersededMessage superseded;
      superseded.generation = *landing_;
      superseded.by = land.generation;
      say(superseded);
    }
    landing_ = land.generation;
    load_.clear();
    sentBytes_ = 0;
    PlanMessage message;
    message.generation = land.generation;
    message.position = land.position;
    message.radiusM = message.releaseRadiusM = message.effectiveRadiusM = land.radiusM;
    const std::vector<std::uint32_t> wanted = scene_.within(land.position, land.radiusM);
    for (const std::uint32_t segment : wanted) {
      if (held_.count(segment) != 0) {
        message.keep.push_back(segment);
      } else {
        load_.push_back(segment);
        message.load.push_back(scene_.facts[segment]);
      }
    }
    message.loadBytes = scene_.bytesOf(load_);
    message.loadTriangles = 10 * load_.size();
    message.totalBytes = scene_.bytesOf(wanted);
    message.totalTriangles = 10 * wanted.size();
    say(std::move(message));
  }

  void answer(const PickMessage& pick) {
    PickedMessage picked;
    picked.request = pick.request;
    picked.hit.emplace();
    picked.hit->normal = {0, 1, 0};
    picked.hit->segment = 3;
    say(std::move(picked));
  }

  const ToyScene& scene_;
  std::deque<ServerMessage> out_;
  MessageReader reader_;
  std::set<std::uint32_t> held_;
  std::uint64_t credit_ = 0;
  /// Generation of the landing that is being sent, what of it is still to be sent, and how far the first of that is.
  std::optional<std::uint32_t> landing_;
  std::deque<std::uint32_t> load_;
  std::size_t sentBytes_ = 0;
};

}  // namespace terraport::testing
