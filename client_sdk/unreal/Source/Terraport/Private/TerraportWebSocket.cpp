#include "TerraportWebSocket.h"

#include "Core/Messages.h"
#include "IWebSocket.h"
#include "Modules/ModuleManager.h"
#include "TerraportText.h"
#include "WebSocketsModule.h"

#include <deque>
#include <utility>

namespace
{
constexpr int Abnormal = 1006;
/** Messages that wait to be read: what credit lets the service send, and more. */
constexpr std::size_t MaxWaitingBytes = std::size_t(512) << 20;
} // namespace

struct FTerraportWebSocket::FState
{
	State Connection = State::Connecting;
	int CloseCode = 0;
	std::string CloseReason;
	/** A message whose last fragment has not come. */
	terraport::Bytes Part;
	std::deque<terraport::Bytes> Whole;
	std::size_t WaitingBytes = 0;

	void Fail(int Code, const std::string& Reason)
	{
		if (Connection != State::Closed)
		{
			Connection = State::Closed;
			CloseCode = Code;
			CloseReason = Reason;
		}
	}

	void Take(const uint8* Data, std::size_t Size, bool bIsLast)
	{
		if (Connection == State::Closed)
		{
			return;
		}
		if (Size > terraport::kMaxMessageBytes - Part.size() || Size > MaxWaitingBytes - WaitingBytes)
		{
			Fail(Abnormal, "got a message that is too long, or too many of them");
			return;
		}
		Part.insert(Part.end(), Data, Data + Size);
		WaitingBytes += Size;
		if (bIsLast)
		{
			Whole.push_back(std::exchange(Part, terraport::Bytes()));
		}
	}
};

FTerraportWebSocket::FTerraportWebSocket(const std::string& Url, const std::string& Subprotocol, const std::string& Token)
	: Shared(MakeShared<FState>())
{
	TArray<FString> Protocols;
	Protocols.Add(TerraportText::FromUtf8(Subprotocol));
	TMap<FString, FString> Headers;
	if (!Token.empty())
	{
		Headers.Add(TEXT("Authorization"), TEXT("Bearer ") + TerraportText::FromUtf8(Token));
	}
	FWebSocketsModule& Module = FModuleManager::LoadModuleChecked<FWebSocketsModule>(TEXT("WebSockets"));
	Socket = Module.CreateWebSocket(TerraportText::FromUtf8(Url), Protocols, Headers);
	// Callbacks hold the state and not this: nothing promises when the module lets go of them.
	const TSharedRef<FState> Kept = Shared;
	Socket->OnConnected().AddLambda([Kept]() {
		if (Kept->Connection == State::Connecting)
		{
			Kept->Connection = State::Open;
		}
	});
	Socket->OnConnectionError().AddLambda([Kept](const FString& Error) { Kept->Fail(Abnormal, TerraportText::ToUtf8(Error)); });
	Socket->OnClosed().AddLambda([Kept](int32 Code, const FString& Reason, bool bWasClean) {
		// A connection that broke has no code of the server's, whatever the platform reports.
		const bool bHasCode = bWasClean || Code >= 3000;
		Kept->Fail(bHasCode && Code > 0 ? int(Code) : Abnormal, TerraportText::ToUtf8(Reason));
	});
	Socket->OnBinaryMessage().AddLambda([Kept](const void* Data, SIZE_T Size, bool bIsLastFragment) {
		Kept->Take(static_cast<const uint8*>(Data), std::size_t(Size), bIsLastFragment);
	});
	// The protocol has no text.
	Socket->OnMessage().AddLambda([Kept](const FString&) { Kept->Fail(4400, "got text, expected binary messages"); });
	// Last, since it may report at once.
	Socket->Connect();
}

FTerraportWebSocket::~FTerraportWebSocket()
{
	close(1000, std::string());
}

terraport::Transport::State FTerraportWebSocket::state() const
{
	return Shared->Connection;
}

bool FTerraportWebSocket::tryReceive(terraport::Bytes& Message)
{
	if (Shared->Whole.empty())
	{
		return false;
	}
	Message = std::move(Shared->Whole.front());
	Shared->Whole.pop_front();
	Shared->WaitingBytes -= Message.size();
	return true;
}

bool FTerraportWebSocket::trySend(terraport::ByteSpan Bytes)
{
	if (Shared->Connection != State::Open || !Socket.IsValid())
	{
		return false;
	}
	Socket->Send(Bytes.data, SIZE_T(Bytes.size), true);
	return true;
}

int FTerraportWebSocket::closeCode() const
{
	return Shared->CloseCode;
}

std::string FTerraportWebSocket::closeReason() const
{
	return Shared->CloseReason;
}

void FTerraportWebSocket::close(int Code, const std::string& Reason)
{
	Shared->Fail(Code, Reason);
	if (Socket.IsValid())
	{
		// No callback of a connection that was left may be taken for one of the next.
		Socket->OnConnected().Clear();
		Socket->OnConnectionError().Clear();
		Socket->OnClosed().Clear();
		Socket->OnBinaryMessage().Clear();
		Socket->OnMessage().Clear();
		Socket->Close(Code, TerraportText::FromUtf8(Reason));
		Socket.Reset();
	}
}
