// The transport over libwebsockets: for tools on Linux, and an example of how a library that calls back becomes a polled one.
#pragma once

#include "Terraport/Transport.h"

#include <memory>

namespace terraport::tools {

/// Makes transports that connect by ws or wss, each with an event loop of its own that runs while it is polled.
std::shared_ptr<TransportFactory> makeLwsTransports();

}  // namespace terraport::tools
