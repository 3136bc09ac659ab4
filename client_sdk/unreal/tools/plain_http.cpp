#include "plain_http.h"

#include <netdb.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdlib>
#include <utility>

namespace terraport::tools {
namespace {

/// A connected socket; -1 where there is none.
int connectTo(const std::string& host, const std::string& port) {
  addrinfo hints = {};
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* addresses = nullptr;
  if (getaddrinfo(host.c_str(), port.c_str(), &hints, &addresses) != 0) {
    return -1;
  }
  int connected = -1;
  for (const addrinfo* address = addresses; address != nullptr && connected < 0; address = address->ai_next) {
    connected = socket(address->ai_family, address->ai_socktype, address->ai_protocol);
    if (connected >= 0 && connect(connected, address->ai_addr, address->ai_addrlen) != 0) {
      close(connected);
      connected = -1;
    }
  }
  freeaddrinfo(addresses);
  return connected;
}

bool sendAll(int connection, const std::string& text) {
  for (std::size_t sent = 0; sent < text.size();) {
    const ssize_t count = send(connection, text.data() + sent, text.size() - sent, MSG_NOSIGNAL);
    if (count <= 0) {
      return false;
    }
    sent += static_cast<std::size_t>(count);
  }
  return true;
}

/// One GET over a connection of its own; blocks until the server closes it.
HttpAnswer fetch(const std::string& url, const std::string& token, std::size_t maxBytes) {
  // 1. Connect.
  HttpAnswer answer;
  const std::string scheme = "http://";
  if (url.compare(0, scheme.size(), scheme) != 0) {
    answer.reason = "not an http URL";
    return answer;
  }
  const std::size_t slash = url.find('/', scheme.size());
  const std::string authority = url.substr(scheme.size(), slash == std::string::npos ? slash : slash - scheme.size());
  const std::size_t colon = authority.rfind(':');
  const std::string host = authority.substr(0, colon);
  const int connection = connectTo(host, colon == std::string::npos ? "80" : authority.substr(colon + 1));
  if (connection < 0) {
    answer.reason = "no connection to " + authority;
    return answer;
  }
  // 2. Send, and read up to the bound: `maxBytes` of body and 64 KiB of headers.
  std::string request = "GET " + (slash == std::string::npos ? "/" : url.substr(slash)) + " HTTP/1.1\r\nHost: " + authority;
  request += "\r\nConnection: close\r\nAccept-Encoding: identity\r\n";
  if (!token.empty()) {
    request += "Authorization: Bearer " + token + "\r\n";
  }
  std::string response;
  if (sendAll(connection, request + "\r\n")) {
    char buffer[65536];
    for (ssize_t size = 0; (size = recv(connection, buffer, sizeof buffer, 0)) > 0;) {
      response.append(buffer, static_cast<std::size_t>(size));
      if (response.size() > maxBytes + 65536) {
        answer.isTooLarge = true;
        break;
      }
    }
  }
  close(connection);
  // 3. Status and body.
  const std::size_t end = response.find("\r\n\r\n");
  if (end == std::string::npos || response.compare(0, 9, "HTTP/1.1 ") != 0) {
    answer.reason = "no answer";
    return answer;
  }
  answer.status = std::atoi(response.c_str() + 9);
  answer.body.assign(response.begin() + static_cast<std::ptrdiff_t>(end + 4), response.end());
  answer.isTooLarge = answer.isTooLarge || answer.body.size() > maxBytes;
  return answer;
}

}  // namespace

std::uint64_t PlainHttp::get(const std::string& url, const std::string& bearerToken, std::size_t maxBytes) {
  answers_[++last_] = fetch(url, bearerToken, maxBytes);
  return last_;
}

bool PlainHttp::poll(std::uint64_t request, HttpAnswer& answer) {
  const auto entry = answers_.find(request);
  if (entry == answers_.end()) {
    return false;
  }
  answer = std::move(entry->second);
  answers_.erase(entry);
  return true;
}

void PlainHttp::cancel(std::uint64_t request) {
  answers_.erase(request);
}

}  // namespace terraport::tools
