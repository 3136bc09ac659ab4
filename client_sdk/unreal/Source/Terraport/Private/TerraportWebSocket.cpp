#include "TerraportWebSocket.h"

#include "IWebSocket.h"
#include "Modules/ModuleManager.h"
#include "Terraport/MessageAssembler.h"
#include "TerraportText.h"
#include "WebSocketsModule.h"

namespace
{
constexpr int Abnormal = 1006;
/** Of one text message, where JSON was chosen: a plan of a large landing. The engine's own limit is lower. */
constexpr uint64 MaxTextBytes = 8u * 1024 * 1024;
} // namespace

struct FTerraportWebSocket::FState
{
	terraport::MessageAssembler Assembler;
	terraport::TransportState Connection = terraport::TransportState::Connecting;
	int CloseCode = 0;
	std::string CloseReason;

	void Fail(int Code, const std::string& Reason)
	{
		if (Connection != terraport::TransportState::Closed)
		{
			Connection = terraport::TransportState::Closed;
			CloseCode = Code;
			CloseReason = Reason;
		}
	}

	void Take(const void* Data, SIZE_T Size, bool bIsText, bool bIsLast)
	{
		if (Connection != terraport::TransportState::Open)
		{
			return;
		}
		const terraport::Status Status =
			Assembler.take(terraport::ByteSpan{static_cast<const uint8*>(Data), std::size_t(Size)}, bIsText, bIsLast);
		if (!Status.isOk())
		{
			Fail(Abnormal, Status.text());
		}
	}
};

FTerraportWebSocket::FTerraportWebSocket() : State(MakeShared<FState>()) {}

FTerraportWebSocket::~FTerraportWebSocket()
{
	close(1000, std::string());
}

void FTerraportWebSocket::open(
	const std::string& Url, const std::vector<std::string>& Subprotocols, const std::string& BearerToken)
{
	// 1. One subprotocol: the module does not tell which of several the server chose.
	if (Subprotocols.empty())
	{
		State->Fail(Abnormal, "no subprotocol was offered");
		return;
	}
	Offered = Subprotocols.front();
	TArray<FString> Protocols;
	Protocols.Add(TerraportText::FromUtf8(Offered));
	// 2. The socket; its module runs a thread of its own.
	TMap<FString, FString> Headers;
	if (!BearerToken.empty())
	{
		Headers.Add(TEXT("Authorization"), TEXT("Bearer ") + TerraportText::FromUtf8(BearerToken));
	}
	FWebSocketsModule& Module = FModuleManager::LoadModuleChecked<FWebSocketsModule>(TEXT("WebSockets"));
	Socket = Module.CreateWebSocket(TerraportText::FromUtf8(Url), Protocols, Headers);

	// 3. Callbacks, on the game thread. They hold the state and not this: nothing promises when the module lets go of them.
	const TSharedRef<FState> Shared = State;
	Socket->OnConnected().AddLambda([Shared]() {
		if (Shared->Connection == terraport::TransportState::Connecting)
		{
			Shared->Connection = terraport::TransportState::Open;
		}
	});
	Socket->OnConnectionError().AddLambda(
		[Shared](const FString& Error) { Shared->Fail(Abnormal, TerraportText::ToUtf8(Error)); });
	Socket->OnClosed().AddLambda([Shared](int32 Code, const FString& Reason, bool bWasClean) {
		// A connection that broke has no code of the server's, whatever the platform reports.
		const bool bHasCode = bWasClean || Code >= 3000;
		Shared->Fail(bHasCode && Code > 0 ? int(Code) : Abnormal, TerraportText::ToUtf8(Reason));
	});
	Socket->SetTextMessageMemoryLimit(MaxTextBytes);
	Socket->OnBinaryMessage().AddLambda(
		[Shared](const void* Data, SIZE_T Size, bool bIsLastFragment) { Shared->Take(Data, Size, false, bIsLastFragment); });
	Socket->OnMessage().AddLambda([Shared](const FString& Message) {
		const std::string Text = TerraportText::ToUtf8(Message);
		Shared->Take(Text.data(), Text.size(), true, true);
	});
	// 4. Last, since it may report at once.
	Socket->Connect();
}

terraport::TransportState FTerraportWebSocket::state() const
{
	return State->Connection;
}

std::string FTerraportWebSocket::subprotocol() const
{
	return State->Connection == terraport::TransportState::Open ? Offered : std::string();
}

bool FTerraportWebSocket::tryReceive(terraport::TransportMessage& Message)
{
	return State->Assembler.tryNext(Message);
}

bool FTerraportWebSocket::trySend(terraport::ByteSpan Bytes)
{
	if (State->Connection != terraport::TransportState::Open || !Socket.IsValid())
	{
		return false;
	}
	Socket->Send(Bytes.data, SIZE_T(Bytes.size), true);
	return true;
}

int FTerraportWebSocket::closeCode() const
{
	return State->CloseCode;
}

std::string FTerraportWebSocket::closeReason() const
{
	return State->CloseReason;
}

void FTerraportWebSocket::close(int Code, const std::string& Reason)
{
	State->Fail(Code, Reason);
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

std::unique_ptr<terraport::Transport> FTerraportWebSockets::make()
{
	return std::make_unique<FTerraportWebSocket>();
}
