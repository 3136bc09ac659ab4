#include "TerraportWebSocket.h"

#include "WebSocketsModule.h"
#include "socket_events.h"

#include <doctest/doctest.h>

#include <string>

namespace
{
class FFakeSocket final : public FSocketEvents
{
public:
	virtual void Connect() override { bConnecting = true; }
	virtual void Close(int32 Code, const FString&) override { ClosedWith = Code; }
	virtual bool IsConnected() override { return bConnecting; }
	virtual void Send(const FString&) override {}
	virtual void Send(const void* Data, SIZE_T Size, bool bIsBinary) override
	{
		Sent.assign(static_cast<const char*>(Data), Size);
		bSentBinary = bIsBinary;
	}

	bool bConnecting = false;
	int32 ClosedWith = 0;
	std::string Sent;
	bool bSentBinary = false;
};

class FFakeModule final : public FWebSocketsModule
{
public:
	FFakeModule() { Stub = this; }
	virtual ~FFakeModule() override { Stub = nullptr; }
	virtual TSharedRef<IWebSocket> CreateWebSocket(
		const FString& InUrl, const TArray<FString>& InProtocols, const TMap<FString, FString>& InHeaders) override
	{
		Url = InUrl;
		Protocols = InProtocols;
		Headers = InHeaders;
		return Socket;
	}
	TSharedRef<FFakeSocket> Socket = MakeShared<FFakeSocket>();
	FString Url;
	TArray<FString> Protocols;
	TMap<FString, FString> Headers;
};

std::string TextOf(const terraport::TransportMessage& Message)
{
	return std::string(Message.bytes.begin(), Message.bytes.end());
}
} // namespace

TEST_CASE("one subprotocol is offered, and the token goes as a header")
{
	FFakeModule Module;
	FTerraportWebSocket Socket;
	Socket.open("wss://host/scenes/q/stream", {"terraport.v1.msgpack", "terraport.v2.msgpack"}, "s3cret");
	CHECK(Module.Url == FString(TEXT("wss://host/scenes/q/stream")));
	REQUIRE(Module.Protocols.Num() == 1);
	REQUIRE(Module.Headers.Find(TEXT("Authorization")) != nullptr);
	CHECK(*Module.Headers.Find(TEXT("Authorization")) == FString(TEXT("Bearer s3cret")));
	CHECK(Socket.subprotocol().empty());
	Module.Socket->Connected.Broadcast();
	CHECK(Socket.state() == terraport::TransportState::Open);
	CHECK(Socket.subprotocol() == "terraport.v1.msgpack");
	FTerraportWebSocket Plain;
	Plain.open("ws://host/scenes/q/stream", {"terraport.v1.msgpack"}, "");
	CHECK(Module.Headers.Num() == 0);
}

TEST_CASE("pieces of a binary message become one, text comes whole, and both keep their order")
{
	FFakeModule Module;
	FTerraportWebSocket Socket;
	Socket.open("ws://host/scenes/q/stream", {"terraport.v1.msgpack"}, "");
	Module.Socket->Connected.Broadcast();
	Module.Socket->Binary.Broadcast("ab", 2, false);
	terraport::TransportMessage Message;
	CHECK_FALSE(Socket.tryReceive(Message));
	Module.Socket->Binary.Broadcast("cd", 2, true);
	Module.Socket->Message.Broadcast(FString(TEXT("{\"type\":\"Grüße\"}")));
	REQUIRE(Socket.tryReceive(Message));
	CHECK(TextOf(Message) == "abcd");
	CHECK_FALSE(Message.isText);
	REQUIRE(Socket.tryReceive(Message));
	CHECK(TextOf(Message) == "{\"type\":\"Grüße\"}");
	CHECK(Message.isText);
	CHECK_FALSE(Socket.tryReceive(Message));
}

TEST_CASE("what came before a close can still be taken; the server's code is told, and a broken line is 1006")
{
	FFakeModule Module;
	FTerraportWebSocket Socket;
	Socket.open("ws://host/scenes/q/stream", {"terraport.v1.msgpack"}, "");
	Module.Socket->Connected.Broadcast();
	Module.Socket->Binary.Broadcast("x", 1, true);
	Module.Socket->Closed.Broadcast(4401, FString(TEXT("unauthorised")), true);
	CHECK(Socket.state() == terraport::TransportState::Closed);
	CHECK(Socket.closeCode() == 4401);
	CHECK(Socket.closeReason() == "unauthorised");
	terraport::TransportMessage Message;
	CHECK(Socket.tryReceive(Message));

	FTerraportWebSocket Other;
	Other.open("ws://host/scenes/q/stream", {"terraport.v1.msgpack"}, "");
	Module.Socket->Closed.Broadcast(1000, FString(), false);
	CHECK(Other.closeCode() == 1006);

	FTerraportWebSocket Never;
	Never.open("ws://host/scenes/q/stream", {"terraport.v1.msgpack"}, "");
	Module.Socket->Error.Broadcast(FString(TEXT("no route")));
	CHECK(Never.closeCode() == 1006);
	CHECK(Never.closeReason() == "no route");
}

TEST_CASE("sending needs an open connection")
{
	FFakeModule Module;
	FTerraportWebSocket Socket;
	Socket.open("ws://host/scenes/q/stream", {"terraport.v1.msgpack"}, "");
	const std::vector<std::uint8_t> Bytes{'h', 'i'};
	CHECK_FALSE(Socket.trySend(terraport::viewOf(Bytes)));
	Module.Socket->Connected.Broadcast();
	CHECK(Socket.trySend(terraport::viewOf(Bytes)));
	CHECK(Module.Socket->Sent == "hi");
	CHECK(Module.Socket->bSentBinary);
}

TEST_CASE("closing says so to the other side, and nothing is heard afterwards")
{
	FFakeModule Module;
	{
		FTerraportWebSocket Socket;
		Socket.open("ws://host/scenes/q/stream", {"terraport.v1.msgpack"}, "");
		Module.Socket->Connected.Broadcast();
		Socket.close(4400, "malformed");
		CHECK(Module.Socket->ClosedWith == 4400);
		Module.Socket->Binary.Broadcast("late", 4, true);
		terraport::TransportMessage Message;
		CHECK_FALSE(Socket.tryReceive(Message));
		CHECK(Socket.closeCode() == 4400);
	}
	// And after it was destroyed.
	Module.Socket->Binary.Broadcast("later", 5, true);
	Module.Socket->Closed.Broadcast(1000, FString(), true);
}
