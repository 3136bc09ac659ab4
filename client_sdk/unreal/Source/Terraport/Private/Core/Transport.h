// The WebSocket that the core needs of an engine.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "Core/Basics.h"

namespace terraport {

/// One connection, polled: nothing blocks, nothing calls back. One thread. It must not negotiate permessage-deflate.
class Transport {
 public:
  enum class State : std::uint8_t { Connecting, Open, Closed };

  virtual ~Transport() = default;
  virtual State state() const = 0;
  /// Take the next whole binary message; what came before a close can be taken after it.
  virtual bool tryReceive(Bytes& message) = 0;
  /// Send one binary message; false where the connection is not open.
  virtual bool trySend(ByteSpan bytes) = 0;
  /// The server's code, 1006 where the connection broke or never opened.
  virtual int closeCode() const = 0;
  virtual std::string closeReason() const = 0;
  virtual void close(int code, const std::string& reason) = 0;
};

/// Begins to connect to a ws or wss URL with that subprotocol. A token that is not empty goes into `Authorization: Bearer`.
using TransportFactory =
    std::function<std::unique_ptr<Transport>(const std::string& url, const std::string& subprotocol, const std::string& token)>;

}  // namespace terraport
