#include "engine_network.h"

#include "../socket_events.h"
#include "lws_transport.h"

#include "Misc/ConfigCacheIni.h"

#include <netdb.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace EngineNetwork
{
namespace
{
constexpr std::size_t PieceBytes = 60000;
/// Of a frame of the game, as the visit has them.
constexpr double GameFrameS = 0.005;
/// In a frame, where the thread does not wait at all.
constexpr int MaxRounds = 50;

/// The engine's thread, counted instead of run: how many rounds it makes in a frame of the game. What it reads when the module
/// is loaded, it keeps.
struct FSocketThread
{
	double FrameTimeS = 1.0 / 30.0;
	double WaitedS = 0.0;
	/// What the engine's module gives libwebsockets for a buffer: its MaxHttpHeaderData.
	unsigned ReceiveBytes = 32 * 1024;
	/// How long a socket must have been still before a round is begun with less than it could take, milliseconds.
	int StillMs = 1;
	bool bInRound = false;
	bool bBusy = false;
	int Rounds = 0;
	FPace Pace;

	void Load()
	{
		GConfig->GetDouble(TEXT("WebSockets.LibWebSockets"), TEXT("ThreadTargetFrameTimeInSeconds"), FrameTimeS, GEngineIni);
		Pace.FrameTimeS = FrameTimeS;
	}
	void BeginFrame()
	{
		WaitedS += GameFrameS;
		Rounds = FrameTimeS > 0.0 ? std::min(MaxRounds, int(WaitedS / FrameTimeS)) : MaxRounds;
		WaitedS -= Rounds * FrameTimeS;
		++Pace.Frames;
		Pace.Rounds += Rounds;
	}
};
FSocketThread Thread;

/// What could have come between two rounds of the engine's thread has come: rounds are what is counted, and not how fast the
/// machine is that counts them.
void AwaitBytes(int Socket)
{
	// A round must be able to take its buffer: how quickly a kernel widens its own for a slow reader is not what is counted.
	const int RoomBytes = 4 * int(Thread.ReceiveBytes);
	(void)setsockopt(Socket, SOL_SOCKET, SO_RCVBUF, &RoomBytes, sizeof(RoomBytes));
	int Waiting = 0, Before = -1;
	for (int Still = 0;
		Still < Thread.StillMs && ioctl(Socket, FIONREAD, &Waiting) == 0 && unsigned(Waiting) < Thread.ReceiveBytes; ++Still)
	{
		Still = Waiting != Before ? 0 : Still;
		Before = Waiting;
		std::this_thread::sleep_for(std::chrono::milliseconds(1));
	}
	Thread.bBusy = Thread.bBusy || Waiting > 0;
}

std::string TextOf(const FString& Text)
{
	return std::string(TCHAR_TO_UTF8(*Text));
}

class FSocket final : public FSocketEvents
{
public:
	FSocket(const FString& InUrl, const TArray<FString>& InProtocols, const TMap<FString, FString>& Headers)
		: Url(TextOf(InUrl))
	{
		for (const FString& Protocol : InProtocols)
		{
			Protocols.push_back(TextOf(Protocol));
		}
		if (const FString* Header = Headers.Find(TEXT("Authorization")))
		{
			Token = TextOf(*Header).substr(std::string("Bearer ").size());
		}
	}
	virtual void Connect() override
	{
		terraport::tools::LwsOptions Options;
		Options.mayService = [](int Socket) {
			if (Thread.bInRound && Socket >= 0)
			{
				AwaitBytes(Socket);
			}
			return Thread.bInRound;
		};
		Options.receiveBytes = Thread.ReceiveBytes;
		Transport = terraport::tools::makeLwsTransports(std::move(Options))->make();
		Transport->open(Url, Protocols, Token);
	}
	virtual void Close(int32 Code, const FString& Reason) override
	{
		if (Transport)
		{
			Transport->close(Code, TextOf(Reason));
		}
		Transport.reset();
	}
	virtual bool IsConnected() override { return Transport && Transport->state() == terraport::TransportState::Open; }
	virtual void Send(const FString& Text) override
	{
		const std::string Bytes = TextOf(Text);
		Send(Bytes.data(), Bytes.size(), false);
	}
	virtual void Send(const void* Data, SIZE_T Size, bool bIsBinary) override
	{
		if (bIsBinary)
		{
			(void)Transport->trySend({static_cast<const std::uint8_t*>(Data), Size});
		}
	}

	void Pump()
	{
		for (int Round = 0; Transport && Round < Thread.Rounds; ++Round)
		{
			Thread.bInRound = true;
			(void)Transport->state();
			Thread.bInRound = false;
		}
		terraport::TransportMessage Received;
		while (Transport && Transport->tryReceive(Received))
		{
			Open();
			if (Received.isText)
			{
				Message.Broadcast(FString(UTF8_TO_TCHAR(std::string(Received.bytes.begin(), Received.bytes.end()).c_str())));
				continue;
			}
			for (std::size_t At = 0; At == 0 || At < Received.bytes.size(); At += PieceBytes)
			{
				const std::size_t Size = std::min(PieceBytes, Received.bytes.size() - At);
				Binary.Broadcast(Received.bytes.data() + At, Size, At + Size == Received.bytes.size());
			}
		}
		if (Transport && Transport->state() == terraport::TransportState::Open)
		{
			Open();
		}
		if (Transport && Transport->state() == terraport::TransportState::Closed)
		{
			const int Code = Transport->closeCode();
			const FString Reason(UTF8_TO_TCHAR(Transport->closeReason().c_str()));
			Transport.reset();
			bWasOpen ? Closed.Broadcast(Code, Reason, Code != 1006) : Error.Broadcast(Reason);
		}
	}

private:
	void Open()
	{
		if (!bWasOpen)
		{
			bWasOpen = true;
			Connected.Broadcast();
		}
	}

	std::string Url, Token;
	std::vector<std::string> Protocols;
	std::unique_ptr<terraport::Transport> Transport;
	bool bWasOpen = false;
};

class FResponse final : public IHttpResponse
{
public:
	virtual int32 GetResponseCode() const override { return Code; }
	virtual const TArray<uint8>& GetContent() const override { return Content; }
	int32 Code = 0;
	TArray<uint8> Content;
};

/// GET over one connection, which the server closes; blocks. Null where no answer came.
std::shared_ptr<FResponse> Fetch(const std::string& Url, const std::string& Headers)
{
	// 1. The parts of the URL.
	const std::size_t Host = Url.find("://") + 3, Path = std::min(Url.find('/', Host), Url.size());
	const std::size_t Colon = Url.find(':', Host);
	const std::string Name = Url.substr(Host, std::min(Colon, Path) - Host);
	const std::string Port = Colon < Path ? Url.substr(Colon + 1, Path - Colon - 1) : "80";
	// 2. Connect, send, read to the end.
	addrinfo Hints{}, *Addresses = nullptr;
	Hints.ai_socktype = SOCK_STREAM;
	if (getaddrinfo(Name.c_str(), Port.c_str(), &Hints, &Addresses) != 0)
	{
		return nullptr;
	}
	const int Handle = socket(Addresses->ai_family, Addresses->ai_socktype, Addresses->ai_protocol);
	const bool bConnected = connect(Handle, Addresses->ai_addr, Addresses->ai_addrlen) == 0;
	freeaddrinfo(Addresses);
	std::string Answer;
	const std::string Request = "GET " + (Path < Url.size() ? Url.substr(Path) : "/") + " HTTP/1.1\r\nHost: " + Name +
		"\r\nConnection: close\r\n" + Headers + "\r\n";
	if (bConnected && send(Handle, Request.data(), Request.size(), MSG_NOSIGNAL) == ssize_t(Request.size()))
	{
		char Buffer[65536];
		for (ssize_t Count = 0; (Count = recv(Handle, Buffer, sizeof(Buffer), 0)) > 0;)
		{
			Answer.append(Buffer, std::size_t(Count));
		}
	}
	close(Handle);
	// 3. Status and body, which may come in chunks.
	const std::size_t End = Answer.find("\r\n\r\n");
	if (End == std::string::npos || Answer.compare(0, 5, "HTTP/") != 0)
	{
		return nullptr;
	}
	auto Response = std::make_shared<FResponse>();
	Response->Code = std::atoi(Answer.c_str() + Answer.find(' '));
	std::string Body = Answer.substr(End + 4);
	if (Answer.substr(0, End).find("chunked") != std::string::npos)
	{
		std::string Joined;
		for (std::size_t At = 0; At < Body.size();)
		{
			char* After = nullptr;
			const std::size_t Size = std::strtoul(Body.c_str() + At, &After, 16);
			At = std::size_t(After - Body.c_str()) + 2;
			Joined += Body.substr(At, Size);
			At = Size == 0 ? Body.size() : At + Size + 2;
		}
		Body = Joined;
	}
	Response->Content.SetNumUninitialized(int32(Body.size()));
	std::copy(Body.begin(), Body.end(), Response->Content.begin());
	return Response;
}

class FRequest final : public IHttpRequest
{
public:
	struct FShared
	{
		std::mutex Mutex;
		bool bIsOver = false;
		std::shared_ptr<FResponse> Response;
	};
	virtual void SetURL(const FString& InUrl) override { Url = TextOf(InUrl); }
	virtual void SetVerb(const FString&) override {}
	virtual void SetHeader(const FString& Name, const FString& Value) override
	{
		Headers += TextOf(Name) + ": " + TextOf(Value) + "\r\n";
	}
	virtual bool ProcessRequest() override
	{
		std::thread([Kept = Shared, Of = Url, With = Headers]() {
			std::shared_ptr<FResponse> Response = Fetch(Of, With);
			const std::lock_guard<std::mutex> Lock(Kept->Mutex);
			Kept->Response = std::move(Response);
			Kept->bIsOver = true;
		}).detach();
		return true;
	}
	virtual void CancelRequest() override
	{
		bReported = true;
		Complete.ExecuteIfBound(FHttpRequestPtr(), FHttpResponsePtr(), false);
	}
	virtual FHttpRequestCompleteDelegate& OnProcessRequestComplete() override { return Complete; }
	virtual FHttpRequestProgressDelegate64& OnRequestProgress64() override { return Progress; }
	void Pump()
	{
		std::shared_ptr<FResponse> Response;
		{
			const std::lock_guard<std::mutex> Lock(Shared->Mutex);
			if (bReported || !Shared->bIsOver)
			{
				return;
			}
			Response = Shared->Response;
		}
		bReported = true;
		if (Response)
		{
			Progress.ExecuteIfBound(FHttpRequestPtr(), 0, uint64(Response->Content.Num()));
		}
		Complete.ExecuteIfBound(FHttpRequestPtr(), FHttpResponsePtr(TSharedPtr<FResponse>(Response)), Response != nullptr);
	}

private:
	std::string Url, Headers;
	std::shared_ptr<FShared> Shared = std::make_shared<FShared>();
	bool bReported = false;
	FHttpRequestCompleteDelegate Complete;
	FHttpRequestProgressDelegate64 Progress;
};

std::vector<std::weak_ptr<FSocket>> Sockets;
std::vector<std::weak_ptr<FRequest>> Requests;

class FModule final : public FWebSocketsModule
{
public:
	virtual TSharedRef<IWebSocket> CreateWebSocket(
		const FString& Url, const TArray<FString>& Protocols, const TMap<FString, FString>& Headers) override
	{
		const TSharedRef<FSocket> Socket = MakeShared<FSocket>(Url, Protocols, Headers);
		Sockets.push_back(Socket.StubObject);
		return Socket;
	}
};

template <typename T>
void PumpAll(std::vector<std::weak_ptr<T>>& All)
{
	// A callback may make new ones.
	const std::vector<std::weak_ptr<T>> Now = All;
	for (const std::weak_ptr<T>& Item : Now)
	{
		if (const std::shared_ptr<T> Alive = Item.lock())
		{
			Alive->Pump();
		}
	}
	All.erase(std::remove_if(All.begin(), All.end(), [](const std::weak_ptr<T>& Item) { return Item.expired(); }), All.end());
}
} // namespace

void Install(unsigned ReceiveBytes)
{
	Thread.ReceiveBytes = ReceiveBytes;
	static FModule Module;
	FWebSocketsModule::Stub = &Module;
	FModuleManager::Get().StubOnLoad = [](const FName& Name) {
		if (Name == FName(TEXT("WebSockets")))
		{
			Thread.Load();
		}
	};
	FHttpModule::Get().StubMake = []() -> TSharedRef<IHttpRequest, ESPMode::ThreadSafe> {
		const TSharedRef<FRequest> Request = MakeShared<FRequest>();
		Requests.push_back(Request.StubObject);
		return Request;
	};
}

void Await(int StillMs)
{
	Thread.StillMs = StillMs;
}

FPace Pace()
{
	return Thread.Pace;
}

bool Pump()
{
	Thread.BeginFrame();
	Thread.bBusy = Thread.bBusy && Thread.Rounds == 0;
	PumpAll(Requests);
	PumpAll(Sockets);
	return Thread.bBusy;
}
} // namespace EngineNetwork
