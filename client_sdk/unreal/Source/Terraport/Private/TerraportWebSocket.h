#pragma once

#include "CoreMinimal.h"

#include "Terraport/Transport.h"

#include <memory>
#include <string>
#include <vector>

class IWebSocket;

/**
 * The core's transport on the engine's WebSockets module. Game thread: the module calls back there.
 *
 * The token goes as a header (`Authorization: Bearer`). The engine does not say which subprotocol the server chose; exactly one
 * is offered, so it is that one, or the server closes.
 */
class FTerraportWebSocket final : public terraport::Transport
{
public:
	FTerraportWebSocket();
	virtual ~FTerraportWebSocket() override;
	FTerraportWebSocket(const FTerraportWebSocket&) = delete;
	FTerraportWebSocket& operator=(const FTerraportWebSocket&) = delete;

	virtual void open(
		const std::string& Url, const std::vector<std::string>& Subprotocols, const std::string& BearerToken) override;
	virtual terraport::TransportState state() const override;
	virtual std::string subprotocol() const override;
	virtual bool tryReceive(terraport::TransportMessage& Message) override;
	virtual bool trySend(terraport::ByteSpan Bytes) override;
	virtual int closeCode() const override;
	virtual std::string closeReason() const override;
	virtual void close(int Code, const std::string& Reason) override;

private:
	struct FState;
	/** Shared with the callbacks, which may outlive this object by a frame. */
	TSharedRef<FState> State;
	TSharedPtr<IWebSocket> Socket;
	std::string Offered;
};

/** Makes one of them for each connection. */
class FTerraportWebSockets final : public terraport::TransportFactory
{
public:
	virtual std::unique_ptr<terraport::Transport> make() override;
};
