// The core's transport on the engine's WebSocketClient.
#pragma once

#include <memory>

#include "Godot.h"
#include "Terraport/Transport.h"

namespace terraport::godot {

/// What the engine's client tells by its signals while it is polled. They come to a method of an object of a script, so the
/// script's methods hand them on here, by `currentSocket`.
class SocketEvents {
 public:
  virtual ~SocketEvents() = default;
  virtual void onOpen(const std::string& subprotocol) = 0;
  virtual void onFailed() = 0;
  virtual void onClosing(int code, const std::string& reason) = 0;
  virtual void onClosed() = 0;
  virtual void onData() = 0;
};

/// The socket that is polled on this thread right now; null where none is.
SocketEvents* currentSocket();

/// Makes sockets whose signals go to methods of `receiver`, which must outlive them: `_on_socket_open(protocol)`,
/// `_on_socket_failed()`, `_on_socket_closing(code, reason)`, `_on_socket_closed(clean)`, `_on_socket_data()`.
std::shared_ptr<TransportFactory> makeWebSockets(abi::Object* receiver);

}  // namespace terraport::godot
