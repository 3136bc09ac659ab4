#include "Core/SceneUrl.h"

#include <algorithm>
#include <string_view>

namespace terraport {
namespace {

bool isPlain(char letter) {
  return (letter >= '0' && letter <= '9') || (letter >= 'a' && letter <= 'z') || (letter >= 'A' && letter <= 'Z') ||
      std::string_view("_.-~").find(letter) != std::string_view::npos;
}

std::string lower(std::string text) {
  for (char& letter : text) letter = letter >= 'A' && letter <= 'Z' ? static_cast<char>(letter - 'A' + 'a') : letter;
  return text;
}

/// A host name, an IPv4 address or an IPv6 address in brackets, and perhaps a port.
bool isAuthority(std::string_view text) {
  const std::size_t bracket = text.find(']');
  const std::size_t colon = text.find(':', bracket == std::string_view::npos ? 0 : bracket);
  const std::string_view host = text.substr(0, colon);
  if (colon != std::string_view::npos) {
    const std::string_view port = text.substr(colon + 1);
    if (port.empty() || port.size() > 5 || port.find_first_not_of("0123456789") != std::string_view::npos) return false;
  }
  if (bracket != std::string_view::npos) {
    return host.size() > 2 && host.front() == '[' && host.back() == ']' &&
        host.substr(1, host.size() - 2).find_first_not_of("0123456789abcdefABCDEF:.") == std::string_view::npos;
  }
  return !host.empty() && std::all_of(host.begin(), host.end(), isPlain);
}

/// Of a path that a user pasted: what is encoded stays so.
bool isSegment(std::string_view text) {
  return std::all_of(text.begin(), text.end(), [](char letter) { return isPlain(letter) || letter == '%'; });
}

}  // namespace

Status parseSceneUrl(const std::string& url, SceneUrl& out) {
  if (url.find_first_of("?#@") != std::string::npos) {
    return Status::failed("invalid_url", "URL has credentials, a query or a fragment, expected none of them");
  }
  const Status invalid = Status::failed("invalid_url", "URL " + url + ", expected http(s)://host[:port][/prefix]/scenes/ID");
  const std::size_t slashes = url.find("://");
  if (slashes == std::string::npos) return invalid;
  const std::string scheme = lower(url.substr(0, slashes));
  const bool isSecure = scheme == "https" || scheme == "wss";
  if (!isSecure && scheme != "http" && scheme != "ws") return invalid;
  const std::size_t pathAt = std::min(url.find('/', slashes + 3), url.size());
  const std::string authority = url.substr(slashes + 3, pathAt - slashes - 3);
  std::string path = url.substr(pathAt);
  const bool isClean = std::all_of(path.begin(), path.end(), [](char letter) { return letter > ' ' && letter != '\\'; });
  if (!isAuthority(authority) || !isClean) return invalid;
  // A prefix of the server's, "/scenes", and perhaps an id, with or without "/stream".
  while (!path.empty() && path.back() == '/') path.pop_back();
  const std::size_t scenesAt = path.find("/scenes");
  std::string scene = scenesAt == std::string::npos ? "" : path.substr(scenesAt + 7);
  constexpr std::string_view kStream = "/stream";
  if (scene.size() > kStream.size() && scene.compare(scene.size() - kStream.size(), kStream.size(), kStream) == 0) {
    scene.resize(scene.size() - kStream.size());
  }
  if (!scene.empty() && (scene.front() != '/' || !isSegment(scene.substr(1)))) return invalid;
  out.server = (isSecure ? "https://" : "http://") + lower(authority) + path.substr(0, scenesAt);
  out.scene = scene.empty() ? "" : scene.substr(1);
  return {};
}

std::string percentEncoded(const std::string& text) {
  constexpr char kDigits[] = "0123456789ABCDEF";
  std::string out;
  for (const char letter : text) {
    const auto byte = static_cast<unsigned char>(letter);
    isPlain(letter) ? void(out.push_back(letter)) : void(out.append({'%', kDigits[byte >> 4], kDigits[byte & 15]}));
  }
  return out;
}

}  // namespace terraport
