#pragma once

#include "IWebSocket.h"

/// The events of an IWebSocket, for the sockets of these tests: what is done with them is theirs.
class FSocketEvents : public IWebSocket
{
public:
	virtual FWebSocketConnectedEvent& OnConnected() override { return Connected; }
	virtual FWebSocketConnectionErrorEvent& OnConnectionError() override { return Error; }
	virtual FWebSocketClosedEvent& OnClosed() override { return Closed; }
	virtual FWebSocketMessageEvent& OnMessage() override { return Message; }
	virtual FWebSocketBinaryMessageEvent& OnBinaryMessage() override { return Binary; }
	virtual void SetTextMessageMemoryLimit(uint64) override {}

	FWebSocketConnectedEvent Connected;
	FWebSocketConnectionErrorEvent Error;
	FWebSocketClosedEvent Closed;
	FWebSocketMessageEvent Message;
	FWebSocketBinaryMessageEvent Binary;
};
