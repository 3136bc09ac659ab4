#pragma once

#include "HttpModule.h"
#include "IWebSocket.h"
#include "WebSocketsModule.h"

/// The stubs' network made real: WebSockets by libwebsockets, HTTP by plain sockets. What comes is told in `Pump`, as the engine
/// tells it on the game thread; binary messages come in pieces of 60,000 bytes.
namespace EngineNetwork
{
/// Let the stubs' modules make such connections, from now on.
void Install();
/// Tell what came; once a frame.
void Pump();
} // namespace EngineNetwork
