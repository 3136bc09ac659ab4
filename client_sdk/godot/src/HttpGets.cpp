#include "HttpGets.h"

#include <algorithm>
#include <utility>
#include <vector>

namespace terraport::godot {

namespace {

Method kConnect{"HTTPClient", "connect_to_host"};
Method kSetChunk{"HTTPClient", "set_read_chunk_size"};
Method kPoll{"HTTPClient", "poll"};
Method kStatus{"HTTPClient", "get_status"};
Method kRequest{"HTTPClient", "request"};
Method kCode{"HTTPClient", "get_response_code"};
Method kHasResponse{"HTTPClient", "has_response"};
Method kRead{"HTTPClient", "read_response_body_chunk"};

constexpr int kChunkBytes = 1 << 16;
/// Chunks of one poll, so that several requests take turns.
constexpr int kPollChunks = 64;
constexpr int kGet = 0;  // HTTPClient.METHOD_GET

/// HTTPClient.Status.
enum ClientStatus : std::int64_t {
  kDisconnected,
  kResolving,
  kCannotResolve,
  kConnecting,
  kCannotConnect,
  kConnected,
  kRequesting,
  kBody,
  kConnectionError,
  kTlsError,
};

struct Address {
  bool isSecure = false;
  std::string host;
  int port = 0;
  std::string path;
};

/// Parts of an http(s) URL, as the core makes them.
bool split(const std::string& url, Address& address) {
  address.isSecure = url.rfind("https://", 0) == 0;
  if (!address.isSecure && url.rfind("http://", 0) != 0) return false;
  const std::size_t start = address.isSecure ? 8 : 7;
  const std::size_t slash = std::min(url.find('/', start), url.size());
  std::string host = url.substr(start, slash - start);
  address.path = slash < url.size() ? url.substr(slash) : "/";
  address.port = address.isSecure ? 443 : 80;
  const std::size_t bracket = host.find(']');
  const std::size_t colon = host.find(':', bracket == std::string::npos ? 0 : bracket);
  if (colon != std::string::npos) {
    address.port = std::atoi(host.c_str() + colon + 1);
    host.resize(colon);
  }
  address.host = bracket == std::string::npos ? host : host.substr(1, bracket - 1);
  return !address.host.empty() && address.port > 0 && address.port < 65536;
}

}  // namespace

std::uint64_t HttpGets::get(const std::string& url, const std::string& bearerToken, std::size_t maxBytes) {
  Exchange& exchange = exchanges_[++last_];
  exchange.maxBytes = maxBytes;
  exchange.token = bearerToken;
  Address address;
  if (!split(url, address)) {
    exchange.fail("not an http or https address");
    return last_;
  }
  exchange.path = address.path;
  exchange.client = make("HTTPClient");
  (void)kSetChunk(exchange.client, kChunkBytes);
  if (kConnect(exchange.client, address.host, address.port, address.isSecure, true).toInt() != 0) {
    exchange.fail("the engine could not begin to connect");
  }
  return last_;
}

bool HttpGets::poll(std::uint64_t request, HttpAnswer& answer) {
  const auto entry = exchanges_.find(request);
  if (entry == exchanges_.end()) return false;
  if (!entry->second.isOver) entry->second.step();
  if (!entry->second.isOver) return false;
  answer = std::move(entry->second.answer);
  exchanges_.erase(entry);
  return true;
}

std::uint64_t HttpGets::receivedBytes(std::uint64_t request) const {
  const auto entry = exchanges_.find(request);
  return entry == exchanges_.end() ? 0 : entry->second.answer.body.size();
}

void HttpGets::cancel(std::uint64_t request) {
  exchanges_.erase(request);
}

void HttpGets::Exchange::step() {
  (void)kPoll(client);
  const std::int64_t status = kStatus(client).toInt();
  switch (status) {
    case kResolving:
    case kConnecting:
    case kRequesting:
      return;
    case kConnected:
    case kDisconnected:
      if (isAsked) {
        // A body that has ended, or an answer without one.
        isOver = kHasResponse(client).toBool() || answer.status != 0;
        if (!isOver) return fail("the server closed the connection before it answered");
        if (answer.status == 0) answer.status = static_cast<int>(kCode(client).toInt());
        return;
      }
      if (status == kConnected) {
        std::vector<std::string> headers;
        if (!token.empty()) headers.push_back("Authorization: Bearer " + token);
        isAsked = true;
        if (kRequest(client, kGet, path, stringArray(headers)).toInt() != 0) fail("the engine could not send the request");
        return;
      }
      return fail("the connection was closed");
    case kBody:
      return read();
    case kCannotResolve:
      return fail("the server's name is not known");
    case kTlsError:
      return fail("no secure connection: the certificate, or its name, is not trusted");
    default:
      return fail("the connection failed");
  }
}

void HttpGets::Exchange::read() {
  answer.status = static_cast<int>(kCode(client).toInt());
  for (int chunk = 0; chunk < kPollChunks; ++chunk) {
    const std::vector<std::uint8_t> bytes = kRead(client).toBytes();
    const std::size_t room = maxBytes - answer.body.size();
    answer.body.insert(answer.body.end(), bytes.begin(), bytes.begin() + std::ptrdiff_t(std::min(bytes.size(), room)));
    if (bytes.size() > room) {
      answer.isTooLarge = true;
      isOver = true;
      return;
    }
    // Read to its end, the client goes back to "connected"; an empty chunk is one that has not come yet.
    if (kStatus(client).toInt() != kBody || bytes.empty()) return;
  }
}

void HttpGets::Exchange::fail(const std::string& reason) {
  isOver = true;
  answer.status = 0;
  answer.reason = reason;
}

}  // namespace terraport::godot
