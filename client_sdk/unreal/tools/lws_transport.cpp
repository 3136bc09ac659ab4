#include "lws_transport.h"

#include "Terraport/MessageAssembler.h"

#include <libwebsockets.h>

#include <algorithm>
#include <cstring>
#include <deque>
#include <string>
#include <utility>
#include <vector>

namespace terraport::tools {

namespace {

constexpr int kAbnormal = 1006;
constexpr std::size_t kMaxSending = 4 * 1024 * 1024;
/// Rounds of the event loop after `close`, so that what was queued and the close itself leave.
constexpr int kClosingRounds = 20;

int onLws(lws* wsi, lws_callback_reasons reason, void* user, void* in, std::size_t length);

/// Named as the server chooses it, so that libwebsockets takes its choice.
const lws_protocols kProtocols[] = {
    {"terraport.v1.msgpack", onLws, 0, 128 * 1024, 0, nullptr, 0},
    {nullptr, nullptr, 0, 0, 0, nullptr, 0},
};

struct Address {
  bool isSecure = false;
  std::string host;
  int port = 0;
  std::string path;
};

/// Parts of a URL as `streamUrl` writes it.
bool split(const std::string& url, Address& into) {
  into.isSecure = url.rfind("wss://", 0) == 0;
  if (!into.isSecure && url.rfind("ws://", 0) != 0) return false;
  const std::size_t start = into.isSecure ? 6 : 5;
  const std::size_t slash = url.find('/', start);
  if (slash == std::string::npos) return false;
  std::string host = url.substr(start, slash - start);
  into.path = url.substr(slash);
  into.port = into.isSecure ? 443 : 80;
  const std::size_t bracket = host.find(']');
  const std::size_t colon = host.find(':', bracket == std::string::npos ? 0 : bracket);
  if (colon != std::string::npos) {
    into.port = std::atoi(host.c_str() + colon + 1);
    host.resize(colon);
  }
  into.host = bracket == std::string::npos ? host : host.substr(1, bracket - 1);
  return !into.host.empty() && into.port > 0 && into.port < 65536;
}

/// One connection with an event loop of its own, which has no thread: it runs within the calls of this class, and libwebsockets
/// calls back within them.
class LwsTransport final : public Transport {
 public:
  explicit LwsTransport(const LwsOptions& options) : options_(options) {}

  ~LwsTransport() override {
    if (context_ != nullptr) lws_context_destroy(context_);
  }

  void open(const std::string& url, const std::vector<std::string>& subprotocols, const std::string& bearerToken) override {
    if (!split(url, address_)) return fail(kAbnormal, "invalid URL");
    token_ = bearerToken.empty() ? "" : "Bearer " + bearerToken;
    for (const std::string& name : subprotocols) offered_ += (offered_.empty() ? "" : ",") + name;
    lws_context_creation_info info{};
    info.port = CONTEXT_PORT_NO_LISTEN;
    info.protocols = kProtocols;
    info.options = LWS_SERVER_OPTION_DO_SSL_GLOBAL_INIT;
    info.pt_serv_buf_size = options_.receiveBytes;
    context_ = lws_create_context(&info);
    if (context_ == nullptr) return fail(kAbnormal, "no event loop");
    lws_client_connect_info connect{};
    connect.context = context_;
    connect.address = address_.host.c_str();
    connect.host = address_.host.c_str();
    connect.origin = nullptr;
    connect.port = address_.port;
    connect.path = address_.path.c_str();
    connect.ssl_connection = address_.isSecure ? LCCSCF_USE_SSL : 0;
    connect.protocol = offered_.c_str();
    connect.opaque_user_data = this;
    // No extensions are given: payloads are compressed once already.
    if (lws_client_connect_via_info(&connect) == nullptr && state_ != TransportState::Closed) {
      fail(kAbnormal, "the connection could not be begun");
    }
  }

  TransportState state() const override {
    // The loop runs where it is asked how things are: nobody else would.
    const_cast<LwsTransport*>(this)->service();
    return state_;
  }

  std::string subprotocol() const override { return chosen_; }

  bool tryReceive(TransportMessage& message) override {
    if (assembler_.waitingBytes() == 0) service();
    if (!assembler_.tryNext(message)) return false;
    if (isThrottled_ && assembler_.hasRoom() && wsi_ != nullptr) {
      isThrottled_ = false;
      lws_rx_flow_control(wsi_, 1);
    }
    return true;
  }

  bool trySend(ByteSpan bytes) override {
    if (state_ != TransportState::Open || isClosing_ || sendingBytes_ > kMaxSending) return false;
    // libwebsockets writes the frame's header into the LWS_PRE bytes before the payload.
    Outgoing outgoing;
    outgoing.bytes.resize(LWS_PRE + bytes.size);
    if (bytes.size > 0) std::memcpy(outgoing.bytes.data() + LWS_PRE, bytes.data, bytes.size);
    sendingBytes_ += bytes.size;
    sending_.push_back(std::move(outgoing));
    lws_callback_on_writable(wsi_);
    service();
    return true;
  }

  int closeCode() const override { return closeCode_; }
  std::string closeReason() const override { return closeReason_; }

  void close(int code, const std::string& reason) override {
    if (state_ != TransportState::Open || isClosing_) return;
    isClosing_ = true;
    ownCode_ = code;
    ownReason_ = reason.substr(0, 120);
    lws_callback_on_writable(wsi_);
    for (int round = 0; round < kClosingRounds && state_ == TransportState::Open; ++round) lws_service(context_, -1);
  }

  /// Non-zero ends the connection.
  int on(lws* wsi, lws_callback_reasons reason, void* in, std::size_t length) {
    switch (reason) {
      case LWS_CALLBACK_CLIENT_APPEND_HANDSHAKE_HEADER:
        return addToken(wsi, static_cast<unsigned char**>(in), length);
      case LWS_CALLBACK_CLIENT_FILTER_PRE_ESTABLISH: {
        char name[64];
        if (lws_hdr_copy(wsi, name, sizeof name, WSI_TOKEN_PROTOCOL) > 0) chosen_ = name;
        return 0;
      }
      case LWS_CALLBACK_CLIENT_ESTABLISHED:
        wsi_ = wsi;
        state_ = TransportState::Open;
        return 0;
      case LWS_CALLBACK_CLIENT_RECEIVE:
        return receive(wsi, static_cast<const std::uint8_t*>(in), length);
      case LWS_CALLBACK_CLIENT_WRITEABLE:
        return write(wsi);
      case LWS_CALLBACK_WS_PEER_INITIATED_CLOSE:
        takeClose(static_cast<const std::uint8_t*>(in), length);
        return 0;
      case LWS_CALLBACK_CLIENT_CONNECTION_ERROR:
        fail(kAbnormal, in == nullptr ? "" : std::string(static_cast<const char*>(in), length));
        return 0;
      case LWS_CALLBACK_CLIENT_CLOSED:
        fail(closeCode_ == 0 ? kAbnormal : closeCode_, closeReason_);
        return 0;
      default:
        return 0;
    }
  }

 private:
  struct Outgoing {
    std::vector<unsigned char> bytes;
  };

  void service() {
    const int socket = wsi_ == nullptr ? -1 : static_cast<int>(lws_get_socket_fd(wsi_));
    if (options_.mayService && !options_.mayService(socket)) return;
    if (context_ != nullptr && state_ != TransportState::Closed) lws_service(context_, -1);
  }

  void fail(int code, const std::string& reason) {
    wsi_ = nullptr;
    if (state_ == TransportState::Closed) return;
    state_ = TransportState::Closed;
    closeCode_ = code;
    closeReason_ = reason;
  }

  int addToken(lws* wsi, unsigned char** at, std::size_t room) const {
    if (token_.empty()) return 0;
    return lws_add_http_header_by_token(wsi, WSI_TOKEN_HTTP_AUTHORIZATION,
        reinterpret_cast<const unsigned char*>(token_.data()), static_cast<int>(token_.size()), at, *at + room);
  }

  int receive(lws* wsi, const std::uint8_t* bytes, std::size_t length) {
    const bool isLast = lws_is_final_fragment(wsi) != 0 && lws_remaining_packet_payload(wsi) == 0;
    const Status status = assembler_.take({bytes, length}, lws_frame_is_binary(wsi) == 0, isLast);
    if (!status.isOk()) {
      closeCode_ = kAbnormal;
      closeReason_ = status.message();
      return -1;
    }
    if (!assembler_.hasRoom()) {
      // Unread, TCP holds the server back.
      isThrottled_ = true;
      lws_rx_flow_control(wsi, 0);
    }
    return 0;
  }

  int write(lws* wsi) {
    if (sending_.empty()) {
      if (!isClosing_) return 0;
      lws_close_reason(
          wsi, static_cast<lws_close_status>(ownCode_), reinterpret_cast<unsigned char*>(ownReason_.data()), ownReason_.size());
      return -1;
    }
    Outgoing& outgoing = sending_.front();
    const std::size_t size = outgoing.bytes.size() - LWS_PRE;
    const int written = lws_write(wsi, outgoing.bytes.data() + LWS_PRE, size, LWS_WRITE_BINARY);
    if (written < static_cast<int>(size)) return -1;
    sendingBytes_ -= size;
    sending_.pop_front();
    if (!sending_.empty() || isClosing_) lws_callback_on_writable(wsi);
    return 0;
  }

  void takeClose(const std::uint8_t* bytes, std::size_t length) {
    if (length < 2) return;
    closeCode_ = bytes[0] * 256 + bytes[1];
    closeReason_.assign(reinterpret_cast<const char*>(bytes) + 2, length - 2);
  }

  LwsOptions options_;
  lws_context* context_ = nullptr;
  lws* wsi_ = nullptr;
  Address address_;
  std::string token_;
  std::string offered_;
  std::string chosen_;
  TransportState state_ = TransportState::Connecting;
  MessageAssembler assembler_;
  bool isThrottled_ = false;
  std::deque<Outgoing> sending_;
  std::size_t sendingBytes_ = 0;
  bool isClosing_ = false;
  int ownCode_ = 0;
  std::string ownReason_;
  int closeCode_ = 0;
  std::string closeReason_;
};

int onLws(lws* wsi, lws_callback_reasons reason, void*, void* in, std::size_t length) {
  auto* const transport = wsi == nullptr ? nullptr : static_cast<LwsTransport*>(lws_get_opaque_user_data(wsi));
  return transport == nullptr ? 0 : transport->on(wsi, reason, in, length);
}

class LwsTransports final : public TransportFactory {
 public:
  explicit LwsTransports(LwsOptions options) : options_(std::move(options)) { lws_set_log_level(LLL_ERR, nullptr); }

  std::unique_ptr<Transport> make() override { return std::make_unique<LwsTransport>(options_); }

 private:
  LwsOptions options_;
};

}  // namespace

std::shared_ptr<TransportFactory> makeLwsTransports(LwsOptions options) {
  return std::make_shared<LwsTransports>(std::move(options));
}

}  // namespace terraport::tools
