#pragma once

#include "CoreMinimal.h"

#include "Core/Transport.h"

#include <memory>
#include <string>

class IWebSocket;

/**
 * The core's transport on the engine's WebSockets module. Game thread: the module calls back there.
 *
 * The engine does not say which subprotocol the server chose; exactly one is offered, so it is that one, or the server closes.
 */
class FTerraportWebSocket final : public terraport::Transport
{
public:
	FTerraportWebSocket(const std::string& Url, const std::string& Subprotocol, const std::string& Token);
	virtual ~FTerraportWebSocket() override;
	FTerraportWebSocket(const FTerraportWebSocket&) = delete;
	FTerraportWebSocket& operator=(const FTerraportWebSocket&) = delete;

	virtual State state() const override;
	virtual bool tryReceive(terraport::Bytes& Message) override;
	virtual bool trySend(terraport::ByteSpan Bytes) override;
	virtual int closeCode() const override;
	virtual std::string closeReason() const override;
	virtual void close(int Code, const std::string& Reason) override;

private:
	struct FState;
	/** Shared with the callbacks, which may outlive this object by a frame. */
	TSharedRef<FState> Shared;
	TSharedPtr<IWebSocket> Socket;
};
