#include "Terraport/SceneUrl.h"

#include "Utf8.h"

#include <algorithm>
#include <cstdint>
#include <string_view>

namespace terraport {

namespace {

constexpr std::string_view kScenes = "/scenes";
constexpr std::string_view kStream = "/stream";

Status invalid(const std::string& text) {
  return Status::failed("invalid_url", text);
}

std::string lower(std::string_view text) {
  std::string lowered(text);
  for (char& letter : lowered) {
    if (letter >= 'A' && letter <= 'Z') letter = static_cast<char>(letter - 'A' + 'a');
  }
  return lowered;
}

bool isPlain(char letter) {
  return (letter >= '0' && letter <= '9') || (letter >= 'a' && letter <= 'z') || (letter >= 'A' && letter <= 'Z') ||
      std::string_view("_.-~").find(letter) != std::string_view::npos;
}

int hexDigit(char letter) {
  if (letter >= '0' && letter <= '9') return letter - '0';
  if (letter >= 'a' && letter <= 'f') return letter - 'a' + 10;
  if (letter >= 'A' && letter <= 'F') return letter - 'A' + 10;
  return -1;
}

/// As Python's `quote(text, safe="")` does it.
std::string encoded(const std::string& text) {
  static const char digits[] = "0123456789ABCDEF";
  std::string into;
  for (const char letter : text) {
    if (isPlain(letter)) {
      into.push_back(letter);
    } else {
      const auto byte = static_cast<unsigned char>(letter);
      into.append({'%', digits[byte >> 4], digits[byte & 0xF]});
    }
  }
  return into;
}

Result<std::string> decoded(std::string_view text) {
  std::string into;
  for (std::size_t at = 0; at < text.size(); ++at) {
    if (text[at] != '%') {
      into.push_back(text[at]);
      continue;
    }
    const int high = at + 2 < text.size() ? hexDigit(text[at + 1]) : -1;
    const int low = at + 2 < text.size() ? hexDigit(text[at + 2]) : -1;
    if (high < 0 || low < 0) return invalid("scene id has a percent sign without two digits");
    into.push_back(static_cast<char>(16 * high + low));
    at += 2;
  }
  if (!isUtf8(into)) return invalid("scene id, expected UTF-8 behind its percent signs");
  return into;
}

std::string_view withoutSlashes(std::string_view text) {
  while (!text.empty() && text.front() == '/') text.remove_prefix(1);
  while (!text.empty() && text.back() == '/') text.remove_suffix(1);
  return text;
}

/// A host name, an IPv4 address or an IPv6 address in brackets, and perhaps a port.
bool isAuthority(std::string_view text) {
  std::string_view host = text;
  const std::size_t bracket = text.find(']');
  const std::size_t colon = text.find(':', bracket == std::string_view::npos ? 0 : bracket);
  if (colon != std::string_view::npos) {
    host = text.substr(0, colon);
    const std::string_view port = text.substr(colon + 1);
    std::uint32_t number = 0;
    for (const char digit : port.substr(0, 6)) {
      if (digit < '0' || digit > '9') return false;
      number = 10 * number + static_cast<std::uint32_t>(digit - '0');
    }
    if (number < 1 || number > 65535 || port.size() > 5) return false;
  }
  if (!host.empty() && host.front() == '[') {
    return host.size() > 2 && host.back() == ']' && std::all_of(host.begin() + 1, host.end() - 1, [](char letter) {
      return hexDigit(letter) >= 0 || letter == ':' || letter == '.';
    });
  }
  // Everything else that is no ASCII must come as punycode.
  return !host.empty() && std::all_of(host.begin(), host.end(), isPlain);
}

}  // namespace

Result<SceneUrl> parseSceneUrl(const std::string& url) {
  const std::string_view whole = url;
  // 1. First of all: where there may be a secret in it the URL is not shown.
  if (whole.find_first_of("?#@") != std::string_view::npos) {
    return invalid("URL has credentials, a query or a fragment, expected none of them");
  }
  // 2. Scheme, authority and path.
  const std::size_t slashes = whole.find("://");
  const std::string scheme = slashes == std::string_view::npos ? "" : lower(whole.substr(0, slashes));
  const bool isSecure = scheme == "https" || scheme == "wss";
  if (!isSecure && scheme != "http" && scheme != "ws") {
    return invalid("URL " + url + ", expected http(s)://host[:port][/prefix]/scenes/ID (or ws, wss)");
  }
  const std::string_view afterScheme = whole.substr(slashes + 3);
  const std::size_t slash = std::min(afterScheme.find('/'), afterScheme.size());
  const std::string_view authority = afterScheme.substr(0, slash);
  const std::string_view path = afterScheme.substr(slash);
  const bool isClean = std::all_of(path.begin(), path.end(),
      [](char letter) { return static_cast<unsigned char>(letter) > 0x20 && letter != '\\' && letter != 0x7F; });
  if (!isAuthority(authority) || !isClean) {
    return invalid("URL " + url + ", expected http(s)://host[:port][/prefix]/scenes/ID (or ws, wss)");
  }
  const std::string origin = (isSecure ? "https://" : "http://") + lower(authority);
  // 3. The path around "/scenes": a prefix of the server's before it, the scene's id behind, with or without "/stream".
  const std::size_t scenesAt = path.find(kScenes);
  std::string_view prefix = path.substr(0, scenesAt);
  const std::string_view afterScenes = scenesAt == std::string_view::npos ? "" : path.substr(scenesAt + kScenes.size());
  std::string_view scene = withoutSlashes(afterScenes);
  if (scene.size() > kStream.size() && scene.substr(scene.size() - kStream.size()) == kStream) {
    scene.remove_suffix(kStream.size());
  }
  // 4. A server alone, or a server and one scene.
  SceneUrl result;
  if (scene.empty()) {
    while (!prefix.empty() && prefix.back() == '/') prefix.remove_suffix(1);
    result.server = origin + std::string(prefix);
    return result;
  }
  if (scene.find('/') != std::string_view::npos || afterScenes.front() != '/') {
    return invalid("URL path " + std::string(path) + ", expected [/prefix]/scenes/ID");
  }
  Result<std::string> id = decoded(scene);
  if (!id.isOk()) return id.status();
  result.server = origin + std::string(prefix);
  result.scene = id.take();
  return result;
}

Result<std::string> sceneUrlOf(const std::string& serverUrl, const std::string& id) {
  const Result<SceneUrl> parsed = parseSceneUrl(serverUrl);
  if (!parsed.isOk()) return parsed.status();
  return parsed.value().server + std::string(kScenes) + "/" + encoded(id);
}

Result<std::string> streamUrl(const std::string& sceneUrl) {
  const Result<SceneUrl> parsed = parseSceneUrl(sceneUrl);
  if (!parsed.isOk()) return parsed.status();
  const SceneUrl& components = parsed.value();
  if (components.scene.empty()) return invalid(components.server + " names no scene, expected .../scenes/ID");
  return "ws" + components.server.substr(4) + std::string(kScenes) + "/" + encoded(components.scene) + std::string(kStream);
}

}  // namespace terraport
