// The transport over libwebsockets: for tools on Linux, and an example of how a library that calls back becomes a polled one.
#pragma once

#include "Terraport/Transport.h"

#include <functional>
#include <memory>

namespace terraport::tools {

struct LwsOptions {
  /// Asked before each round of an event loop, with its socket (-1 before there is one); the loop does not run where it says
  /// no. None lets all of them run.
  std::function<bool(int)> mayService;
  /// Bytes taken from a socket in one round at most; 0 leaves it to the library.
  unsigned receiveBytes = 0;
};

/// Makes transports that connect by ws or wss, each with an event loop of its own that runs while it is polled.
std::shared_ptr<TransportFactory> makeLwsTransports(LwsOptions options = {});

}  // namespace terraport::tools
