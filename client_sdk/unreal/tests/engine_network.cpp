#include "engine_network.h"

#include "Misc/ConfigCacheIni.h"

#include <libwebsockets.h>
#include <netdb.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace EngineNetwork {
namespace {
/// Of a frame of the game, as the visit has them.
constexpr double GameFrameS = 0.005;
/// In a frame, where the thread does not wait at all.
constexpr int MaxRounds = 50;

/// The engine's thread, counted instead of run: how many rounds it makes in a frame of the game. What it reads when the module
/// is loaded, it keeps.
struct FSocketThread {
  double FrameTimeS = 1.0 / 30.0;
  double WaitedS = 0.0;
  /// What the engine's module gives libwebsockets for a buffer: its MaxHttpHeaderData.
  unsigned ReceiveBytes = 32 * 1024;
  /// How long a socket must have been still before a round is begun with less than it could take, milliseconds.
  int StillMs = 1;
  bool bBusy = false;
  int Rounds = 0;
  FPace Pace;

  void Load() {
    GConfig->GetDouble(TEXT("WebSockets.LibWebSockets"), TEXT("ThreadTargetFrameTimeInSeconds"), FrameTimeS, GEngineIni);
    Pace.FrameTimeS = FrameTimeS;
  }
  void BeginFrame() {
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
void AwaitBytes(int Socket) {
  // A round must be able to take its buffer: how quickly a kernel widens its own for a slow reader is not what is counted.
  const int RoomBytes = 4 * int(Thread.ReceiveBytes);
  (void)setsockopt(Socket, SOL_SOCKET, SO_RCVBUF, &RoomBytes, sizeof(RoomBytes));
  int Waiting = 0, Before = -1;
  for (int Still = 0;
      Still < Thread.StillMs && ioctl(Socket, FIONREAD, &Waiting) == 0 && unsigned(Waiting) < Thread.ReceiveBytes; ++Still) {
    Still = Waiting != Before ? 0 : Still;
    Before = Waiting;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  Thread.bBusy = Thread.bBusy || Waiting > 0;
}

std::string TextOf(const FString& Text) {
  return std::string(TCHAR_TO_UTF8(*Text));
}

int OnLws(lws* Wsi, lws_callback_reasons Reason, void* User, void* In, std::size_t Length);

/// Named as the server chooses it, so that libwebsockets takes its choice.
const lws_protocols OurProtocols[] = {
    {"terraport.v2.msgpack", OnLws, 0, 128 * 1024, 0, nullptr, 0},
    {nullptr, nullptr, 0, 0, 0, nullptr, 0},
};

/// A WebSocket with an event loop of its own, which runs within `Pump`; what comes is told in there, in pieces.
class FSocket final : public IWebSocket {
 public:
  FSocket(const FString& InUrl, const TArray<FString>& InProtocols, const TMap<FString, FString>& Headers)
      : Url(TextOf(InUrl)), Protocol(TextOf(InProtocols[0])) {
    if (const FString* Header = Headers.Find(TEXT("Authorization"))) Authorization = TextOf(*Header);
  }
  virtual ~FSocket() override {
    if (Context != nullptr) lws_context_destroy(Context);
  }
  virtual FWebSocketConnectedEvent& OnConnected() override { return Connected; }
  virtual FWebSocketConnectionErrorEvent& OnConnectionError() override { return Error; }
  virtual FWebSocketClosedEvent& OnClosed() override { return Closed; }
  virtual FWebSocketMessageEvent& OnMessage() override { return Message; }
  virtual FWebSocketBinaryMessageEvent& OnBinaryMessage() override { return Binary; }

  virtual void Connect() override {
    // ws://HOST:PORT/PATH
    const std::size_t Slash = Url.find('/', 5), Colon = Url.find(':', 5);
    const std::string Host = Url.substr(5, std::min(Colon, Slash) - 5), Path = Url.substr(Slash);
    lws_context_creation_info Info{};
    Info.port = CONTEXT_PORT_NO_LISTEN;
    Info.protocols = OurProtocols;
    Info.pt_serv_buf_size = Thread.ReceiveBytes;
    Context = lws_create_context(&Info);
    lws_client_connect_info How{};
    How.context = Context;
    How.address = How.host = Host.c_str();
    How.port = Colon < Slash ? std::atoi(Url.c_str() + Colon + 1) : 80;
    How.path = Path.c_str();
    How.protocol = Protocol.c_str();
    How.opaque_user_data = this;
    if (lws_client_connect_via_info(&How) == nullptr) Fail("the connection could not be begun");
  }
  virtual void Close(int32 Code, const FString& Reason) override {
    OwnCode = Code;
    OwnReason = TextOf(Reason).substr(0, 120);
    // Rounds in which what was queued, and the close itself, leave.
    for (int Round = 0; Round < 20 && Wsi != nullptr; ++Round) {
      lws_callback_on_writable(Wsi);
      lws_service(Context, -1);
    }
    bOver = true;
  }
  virtual bool IsConnected() override { return Wsi != nullptr; }
  virtual void Send(const FString&) override {}
  virtual void Send(const void* Data, SIZE_T Size, bool) override {
    // libwebsockets writes the frame's header into the bytes before the payload.
    std::vector<unsigned char> Bytes(LWS_PRE + Size);
    std::memcpy(Bytes.data() + LWS_PRE, Data, Size);
    Sending.push_back(std::move(Bytes));
    if (Wsi != nullptr) lws_callback_on_writable(Wsi);
  }

  void Pump() {
    for (int Round = 0; Context != nullptr && !bOver && Round < Thread.Rounds; ++Round) {
      if (Wsi != nullptr) AwaitBytes(int(lws_get_socket_fd(Wsi)));
      lws_service(Context, -1);
    }
    if (bIsOpen && !bWasOpen) {
      bWasOpen = true;
      Connected.Broadcast();
    }
    for (const auto& Piece : std::exchange(Pieces, {})) Binary.Broadcast(Piece.first.data(), Piece.first.size(), Piece.second);
    if (bFailed && !bOver) {
      bOver = true;
      const FString Reason(UTF8_TO_TCHAR(CloseReason.c_str()));
      bWasOpen ? Closed.Broadcast(CloseCode, Reason, CloseCode != 1006) : Error.Broadcast(Reason);
    }
  }

  /// Non-zero ends the connection.
  int On(lws* Of, lws_callback_reasons Reason, void* In, std::size_t Length) {
    switch (Reason) {
      case LWS_CALLBACK_CLIENT_APPEND_HANDSHAKE_HEADER: {
        auto** At = static_cast<unsigned char**>(In);
        return Authorization.empty()
            ? 0
            : lws_add_http_header_by_token(Of, WSI_TOKEN_HTTP_AUTHORIZATION,
                  reinterpret_cast<const unsigned char*>(Authorization.data()), int(Authorization.size()), At, *At + Length);
      }
      case LWS_CALLBACK_CLIENT_ESTABLISHED:
        Wsi = Of;
        bIsOpen = true;
        return 0;
      case LWS_CALLBACK_CLIENT_RECEIVE: {
        const auto* Bytes = static_cast<const uint8*>(In);
        const bool bLast = lws_is_final_fragment(Of) != 0 && lws_remaining_packet_payload(Of) == 0;
        Pieces.emplace_back(std::vector<uint8>(Bytes, Bytes + Length), bLast);
        return 0;
      }
      case LWS_CALLBACK_CLIENT_WRITEABLE:
        return Write(Of);
      case LWS_CALLBACK_WS_PEER_INITIATED_CLOSE:
        if (Length >= 2) {
          const auto* Bytes = static_cast<const uint8*>(In);
          CloseCode = Bytes[0] * 256 + Bytes[1];
          CloseReason.assign(reinterpret_cast<const char*>(Bytes) + 2, Length - 2);
        }
        return 0;
      case LWS_CALLBACK_CLIENT_CONNECTION_ERROR:
        Fail(In == nullptr ? "" : std::string(static_cast<const char*>(In), Length));
        return 0;
      case LWS_CALLBACK_CLIENT_CLOSED:
        Fail(CloseReason);
        return 0;
      default:
        return 0;
    }
  }

 private:
  int Write(lws* Of) {
    if (Sending.empty()) {
      if (OwnCode == 0) return 0;
      lws_close_reason(Of, lws_close_status(OwnCode), reinterpret_cast<unsigned char*>(OwnReason.data()), OwnReason.size());
      return -1;
    }
    std::vector<unsigned char>& Bytes = Sending.front();
    if (lws_write(Of, Bytes.data() + LWS_PRE, Bytes.size() - LWS_PRE, LWS_WRITE_BINARY) < int(Bytes.size() - LWS_PRE)) {
      return -1;
    }
    Sending.pop_front();
    if (!Sending.empty() || OwnCode != 0) lws_callback_on_writable(Of);
    return 0;
  }
  void Fail(const std::string& Reason) {
    Wsi = nullptr;
    bFailed = true;
    CloseReason = Reason;
  }

  FWebSocketConnectedEvent Connected;
  FWebSocketConnectionErrorEvent Error;
  FWebSocketClosedEvent Closed;
  FWebSocketMessageEvent Message;
  FWebSocketBinaryMessageEvent Binary;
  std::string Url, Protocol, Authorization;
  lws_context* Context = nullptr;
  lws* Wsi = nullptr;
  std::deque<std::vector<unsigned char>> Sending;
  std::vector<std::pair<std::vector<uint8>, bool>> Pieces;
  bool bIsOpen = false, bWasOpen = false, bFailed = false, bOver = false;
  int OwnCode = 0, CloseCode = 1006;
  std::string OwnReason, CloseReason;
};

int OnLws(lws* Wsi, lws_callback_reasons Reason, void*, void* In, std::size_t Length) {
  auto* const Socket = Wsi == nullptr ? nullptr : static_cast<FSocket*>(lws_get_opaque_user_data(Wsi));
  return Socket == nullptr ? 0 : Socket->On(Wsi, Reason, In, Length);
}

class FResponse final : public IHttpResponse {
 public:
  virtual int32 GetResponseCode() const override { return Code; }
  virtual const TArray<uint8>& GetContent() const override { return Content; }
  int32 Code = 0;
  TArray<uint8> Content;
};

/// GET over one connection, which the server closes; blocks. Null where no answer came.
std::shared_ptr<FResponse> Fetch(const std::string& Url, const std::string& Headers) {
  // 1. The parts of the URL.
  const std::size_t Host = Url.find("://") + 3, Path = std::min(Url.find('/', Host), Url.size());
  const std::size_t Colon = Url.find(':', Host);
  const std::string Name = Url.substr(Host, std::min(Colon, Path) - Host);
  const std::string Port = Colon < Path ? Url.substr(Colon + 1, Path - Colon - 1) : "80";
  // 2. Connect, send, read to the end.
  addrinfo Hints{}, *Addresses = nullptr;
  Hints.ai_socktype = SOCK_STREAM;
  if (getaddrinfo(Name.c_str(), Port.c_str(), &Hints, &Addresses) != 0) return nullptr;
  const int Handle = socket(Addresses->ai_family, Addresses->ai_socktype, Addresses->ai_protocol);
  const bool bConnected = connect(Handle, Addresses->ai_addr, Addresses->ai_addrlen) == 0;
  freeaddrinfo(Addresses);
  std::string Answer;
  const std::string Request = "GET " + (Path < Url.size() ? Url.substr(Path) : "/") + " HTTP/1.1\r\nHost: " + Name +
      "\r\nConnection: close\r\n" + Headers + "\r\n";
  if (bConnected && send(Handle, Request.data(), Request.size(), MSG_NOSIGNAL) == ssize_t(Request.size())) {
    char Buffer[65536];
    for (ssize_t Count = 0; (Count = recv(Handle, Buffer, sizeof(Buffer), 0)) > 0;) Answer.append(Buffer, std::size_t(Count));
  }
  close(Handle);
  // 3. Status and body, which may come in chunks.
  const std::size_t End = Answer.find("\r\n\r\n");
  if (End == std::string::npos || Answer.compare(0, 5, "HTTP/") != 0) return nullptr;
  auto Response = std::make_shared<FResponse>();
  Response->Code = std::atoi(Answer.c_str() + Answer.find(' '));
  std::string Body = Answer.substr(End + 4);
  if (Answer.substr(0, End).find("chunked") != std::string::npos) {
    std::string Joined;
    for (std::size_t At = 0; At < Body.size();) {
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

class FRequest final : public IHttpRequest {
 public:
  struct FShared {
    std::mutex Mutex;
    bool bIsOver = false;
    std::shared_ptr<FResponse> Response;
  };
  virtual void SetURL(const FString& InUrl) override { Url = TextOf(InUrl); }
  virtual void SetVerb(const FString&) override {}
  virtual void SetHeader(const FString& Name, const FString& Value) override {
    Headers += TextOf(Name) + ": " + TextOf(Value) + "\r\n";
  }
  virtual bool ProcessRequest() override {
    std::thread([Kept = Shared, Of = Url, With = Headers]() {
      std::shared_ptr<FResponse> Response = Fetch(Of, With);
      const std::lock_guard<std::mutex> Lock(Kept->Mutex);
      Kept->Response = std::move(Response);
      Kept->bIsOver = true;
    }).detach();
    return true;
  }
  virtual void CancelRequest() override {
    bReported = true;
    Complete.ExecuteIfBound(FHttpRequestPtr(), FHttpResponsePtr(), false);
  }
  virtual FHttpRequestCompleteDelegate& OnProcessRequestComplete() override { return Complete; }
  virtual FHttpRequestProgressDelegate64& OnRequestProgress64() override { return Progress; }
  void Pump() {
    std::shared_ptr<FResponse> Response;
    {
      const std::lock_guard<std::mutex> Lock(Shared->Mutex);
      if (bReported || !Shared->bIsOver) return;
      Response = Shared->Response;
    }
    bReported = true;
    if (Response) Progress.ExecuteIfBound(FHttpRequestPtr(), 0, uint64(Response->Content.Num()));
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

class FModule final : public FWebSocketsModule {
 public:
  virtual TSharedRef<IWebSocket> CreateWebSocket(
      const FString& Url, const TArray<FString>& Protocols, const TMap<FString, FString>& Headers) override {
    const TSharedRef<FSocket> Socket = MakeShared<FSocket>(Url, Protocols, Headers);
    Sockets.push_back(Socket.StubObject);
    return Socket;
  }
};

template <typename T>
void PumpAll(std::vector<std::weak_ptr<T>>& All) {
  // A callback may make new ones.
  const std::vector<std::weak_ptr<T>> Now = All;
  for (const std::weak_ptr<T>& Item : Now) {
    if (const std::shared_ptr<T> Alive = Item.lock()) Alive->Pump();
  }
  All.erase(std::remove_if(All.begin(), All.end(), [](const std::weak_ptr<T>& Item) { return Item.expired(); }), All.end());
}
} // namespace

void Install(unsigned ReceiveBytes) {
  Thread.ReceiveBytes = ReceiveBytes;
  lws_set_log_level(LLL_ERR, nullptr);
  static FModule Module;
  FWebSocketsModule::Stub = &Module;
  FModuleManager::Get().StubOnLoad = [](const FName& Name) {
    if (Name == FName(TEXT("WebSockets"))) Thread.Load();
  };
  FHttpModule::Get().StubMake = []() -> TSharedRef<IHttpRequest, ESPMode::ThreadSafe> {
    const TSharedRef<FRequest> Request = MakeShared<FRequest>();
    Requests.push_back(Request.StubObject);
    return Request;
  };
}

void Await(int StillMs) {
  Thread.StillMs = StillMs;
}

FPace Pace() {
  return Thread.Pace;
}

bool Pump() {
  Thread.BeginFrame();
  Thread.bBusy = Thread.bBusy && Thread.Rounds == 0;
  PumpAll(Requests);
  PumpAll(Sockets);
  return Thread.bBusy;
}
} // namespace EngineNetwork
