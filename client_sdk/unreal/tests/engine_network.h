#pragma once

#include "HttpModule.h"
#include "IWebSocket.h"
#include "WebSocketsModule.h"

/// The stubs' network made real: WebSockets by libwebsockets, HTTP by plain sockets. What comes is told in `Pump`, as the
/// engine tells it on the game thread; messages come in pieces. The socket is looked at as often as the
/// engine's thread would do it at the pace that the configuration had when the module was loaded, and gives a buffer at a time:
/// in rounds that are counted against frames of 5 ms. Time is these frames; a round waits for what the service sends meanwhile.
namespace EngineNetwork {
struct FPace {
  double FrameTimeS = 0.0;
  int Frames = 0;
  int Rounds = 0;
};

/// Let the stubs' modules make such connections, from now on; a round takes at most so many bytes.
void Install(unsigned ReceiveBytes);
/// Tell what came; once a frame. True while the socket brings something.
bool Pump();
/// Begin a round only when nothing has come for so long, or as much as it can take is here: then a round that brings nothing is
/// one in which the service had nothing to send, and not one in which it was too busy to.
void Await(int StillMs);
/// Frames and rounds since the start.
FPace Pace();
} // namespace EngineNetwork
