// Transports whose other end is a server that answers, in memory: a network that can be cut, held and spoilt.
#pragma once

#include "Terraport/Transport.h"
#include "Terraport/Xxh3.h"
#include "stream_server.h"

#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace terraport::testing {

/// The toy scene as a stream checks it.
inline const ToyScene kStreamToy;

/// What all connections of one stream share.
struct FakeNetwork {
  explicit FakeNetwork(const ToyScene& toy) : scene(&toy) {}

  const ToyScene* scene;
  std::unique_ptr<AnsweringServer> server;
  /// Connections so far, and what each was opened with.
  int opened = 0;
  std::string url;
  std::vector<std::string> subprotocols;
  std::string token;
  /// Connections are not made.
  bool isDown = false;
  /// Nothing comes through.
  bool isSilent = false;
  /// Nothing goes out.
  bool isFull = false;
  /// What the next connection is closed with as soon as it is open, and what is said before.
  int closesWith = 0;
  std::optional<ServerMessage> says;
  std::string chosen;
  /// Close code that the client gave.
  int clientCode = 0;
  /// The present connection breaks with this code.
  int breaksWith = 0;
  std::string breakReason;
};

class FakeTransport final : public Transport {
 public:
  explicit FakeTransport(std::shared_ptr<FakeNetwork> network) : network_(std::move(network)) {}

  void open(const std::string& url, const std::vector<std::string>& subprotocols, const std::string& token) override {
    network_->opened += 1;
    network_->url = url;
    network_->subprotocols = subprotocols;
    network_->token = token;
    if (network_->isDown) return end(1006, "");
    network_->server = std::make_unique<AnsweringServer>(*network_->scene);
    state_ = TransportState::Open;
    if (network_->closesWith != 0) {
      if (network_->says) {
        EncodedMessage data;
        (void)encodeMessage(*network_->says, data).isOk();
        first_.push_back(data);
      }
      end(network_->closesWith, "");
    }
  }

  TransportState state() const override {
    if (network_->breaksWith != 0 && state_ != TransportState::Closed) {
      auto* const self = const_cast<FakeTransport*>(this);
      self->end(network_->breaksWith, network_->breakReason);
      network_->breaksWith = 0;
    }
    return state_;
  }

  std::string subprotocol() const override {
    if (!network_->chosen.empty()) return network_->chosen;
    return kSubprotocol;
  }

  bool tryReceive(TransportMessage& message) override {
    std::optional<EncodedMessage> data;
    if (!first_.empty()) {
      data = first_.front();
      first_.pop_front();
    } else if (!network_->isSilent && state_ == TransportState::Open && network_->server != nullptr) {
      data = network_->server->next();
    }
    if (!data) return false;
    message.isText = false;
    message.bytes.assign(data->bytes.begin(), data->bytes.end());
    return true;
  }

  bool trySend(ByteSpan bytes) override {
    if (state_ != TransportState::Open || network_->isFull) return false;
    network_->server->receive({std::string(reinterpret_cast<const char*>(bytes.data), bytes.size)});
    return true;
  }

  int closeCode() const override { return code_; }
  std::string closeReason() const override { return reason_; }

  void close(int code, const std::string&) override {
    network_->clientCode = code;
    end(code, "");
  }

 private:
  void end(int code, const std::string& reason) {
    state_ = TransportState::Closed;
    code_ = code;
    reason_ = reason;
  }

  std::shared_ptr<FakeNetwork> network_;
  TransportState state_ = TransportState::Connecting;
  std::deque<EncodedMessage> first_;
  int code_ = 0;
  std::string reason_;
};

class FakeTransports final : public TransportFactory {
 public:
  explicit FakeTransports(std::shared_ptr<FakeNetwork> network) : network_(std::move(network)) {}

  std::unique_ptr<Transport> make() override { return std::make_unique<FakeTransport>(network_); }

 private:
  std::shared_ptr<FakeNetwork> network_;
};

}  // namespace terraport::testing
