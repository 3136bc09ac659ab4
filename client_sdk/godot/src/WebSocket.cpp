#include "WebSocket.h"

#include <string>
#include <utility>
#include <vector>

#include "Terraport/MessageAssembler.h"

namespace terraport::godot {

namespace {

Method kSetBuffers{"WebSocketMultiplayerPeer", "set_buffers"};
Method kGetPeer{"WebSocketMultiplayerPeer", "get_peer"};
Method kConnect{"WebSocketClient", "connect_to_url"};
Method kDisconnect{"WebSocketClient", "disconnect_from_host"};
Method kPoll{"NetworkedMultiplayerPeer", "poll"};
Method kGetPacket{"PacketPeer", "get_packet"};
Method kPutPacket{"PacketPeer", "put_packet"};
Method kWasText{"WebSocketPeer", "was_string_packet"};
Method kSetWriteMode{"WebSocketPeer", "set_write_mode"};
Method kConnectSignal{"Object", "connect"};

constexpr int kAbnormal = 1006;
constexpr int kBinary = 1;  // WebSocketPeer.WRITE_MODE_BINARY
/// Of one message, KiB: the protocol's own bound. A message is taken out when it has come, so there is one at a time.
constexpr int kInKibibytes = 8 * 1024;
constexpr int kOutKibibytes = 1024;
constexpr int kPackets = 64;

thread_local SocketEvents* tPolled = nullptr;

/// Used on the stream's thread alone: the engine's client calls back within `poll`, and nowhere else.
class WebSocket final : public Transport, public SocketEvents {
 public:
  explicit WebSocket(abi::Object* receiver) : client_(make("WebSocketClient")) {
    const Variant target = Variant::of(receiver);
    const std::pair<const char*, const char*> kSignals[] = {{"connection_established", "_on_socket_open"},
        {"connection_error", "_on_socket_failed"}, {"server_close_request", "_on_socket_closing"},
        {"connection_closed", "_on_socket_closed"}, {"data_received", "_on_socket_data"}};
    for (const auto& [signal, method] : kSignals) (void)kConnectSignal(client_, signal, target, method);
  }

  ~WebSocket() override { close(1000, std::string()); }

  void open(const std::string& url, const std::vector<std::string>& subprotocols, const std::string& bearerToken) override {
    std::vector<std::string> headers;
    if (!bearerToken.empty()) headers.push_back("Authorization: Bearer " + bearerToken);
    (void)kSetBuffers(client_, kInKibibytes, kPackets, kOutKibibytes, kPackets);
    const std::int64_t error = kConnect(client_, url, stringArray(subprotocols), false, stringArray(headers)).toInt();
    if (error != 0) fail(kAbnormal, "the engine could not begin to connect: error " + std::to_string(error));
  }

  TransportState state() const override {
    // The client has no thread: it works where it is asked how things are.
    const_cast<WebSocket*>(this)->poll();
    return state_;
  }

  std::string subprotocol() const override { return chosen_; }

  bool tryReceive(TransportMessage& message) override {
    if (assembler_.waitingBytes() == 0) poll();
    return assembler_.tryNext(message);
  }

  bool trySend(ByteSpan bytes) override {
    if (state_ != TransportState::Open) return false;
    const Variant packet =
        arrayOf<std::uint8_t>(bytes.size, [&](std::uint8_t* out) { std::copy(bytes.data, bytes.data + bytes.size, out); });
    return kPutPacket(kGetPeer(client_, 1), packet).toInt() == 0;
  }

  int closeCode() const override { return state_ == TransportState::Closed ? closeCode_ : 0; }
  std::string closeReason() const override { return closeReason_; }

  void close(int code, const std::string& reason) override {
    if (isDone_) return;
    isDone_ = true;
    (void)kDisconnect(client_, code, reason);
    fail(code, reason);
  }

 private:
  void poll() {
    if (isDone_ || !assembler_.hasRoom()) return;
    SocketEvents* const outer = std::exchange(tPolled, this);
    (void)kPoll(client_);
    tPolled = outer;
  }

  void fail(int code, const std::string& reason) {
    if (state_ == TransportState::Closed) return;
    state_ = TransportState::Closed;
    closeCode_ = code;
    closeReason_ = reason;
  }

  void onOpen(const std::string& subprotocol) override {
    chosen_ = subprotocol;
    (void)kSetWriteMode(kGetPeer(client_, 1), kBinary);
    if (state_ == TransportState::Connecting) state_ = TransportState::Open;
  }

  void onFailed() override {
    isDone_ = true;
    fail(kAbnormal, "the connection did not come about");
  }

  void onClosing(int code, const std::string& reason) override {
    serverCode_ = code;
    serverReason_ = reason;
  }

  void onClosed() override {
    isDone_ = true;
    // A connection that broke has no code of the server's.
    fail(serverCode_ > 0 ? serverCode_ : kAbnormal, serverCode_ > 0 ? serverReason_ : "the connection broke");
  }

  void onData() override {
    const Variant peer = kGetPeer(client_, 1);
    const std::vector<std::uint8_t> bytes = kGetPacket(peer).toBytes();
    const Status status = assembler_.take(viewOf(bytes), kWasText(peer).toBool(), true);
    if (!status.isOk()) fail(kAbnormal, status.text());
  }

  Variant client_;
  MessageAssembler assembler_;
  TransportState state_ = TransportState::Connecting;
  std::string chosen_;
  int serverCode_ = 0;
  std::string serverReason_;
  int closeCode_ = 0;
  std::string closeReason_;
  /// Nothing is to be had of the client any more.
  bool isDone_ = false;
};

class WebSockets final : public TransportFactory {
 public:
  explicit WebSockets(abi::Object* receiver) : receiver_(receiver) {}
  std::unique_ptr<Transport> make() override { return std::make_unique<WebSocket>(receiver_); }

 private:
  abi::Object* receiver_;
};

}  // namespace

SocketEvents* currentSocket() {
  return tPolled;
}

std::shared_ptr<TransportFactory> makeWebSockets(abi::Object* receiver) {
  return std::make_shared<WebSockets>(receiver);
}

}  // namespace terraport::godot
