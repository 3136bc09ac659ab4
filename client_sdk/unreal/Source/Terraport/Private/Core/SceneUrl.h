#pragma once

#include <string>

#include "Core/Basics.h"

namespace terraport {

/// Where a server, and perhaps one scene of it, is.
struct SceneUrl {
  /// http(s)://host[:port][/prefix] without a slash at the end.
  std::string server;
  /// Percent-encoded as in a URL; empty for a server, whose only scene is meant.
  std::string scene;

  std::string http() const { return server + "/scenes/" + scene; }
  /// Of the WebSocket; with a group, for proxies that route by it.
  std::string stream(const std::string& group = "") const {
    return "ws" + server.substr(4) + "/scenes/" + scene + "/stream" + (group.empty() ? "" : "?group=" + group);
  }
};

/// Read http, https, ws or wss URLs of a server or of a scene, with or without "/stream". Refused (`invalid_url`) are those
/// with credentials, a query or a fragment; they are not repeated in the message, as they may hold a secret.
Status parseSceneUrl(const std::string& url, SceneUrl& out);

/// Percent-encode all but letters, digits and "_.-~".
std::string percentEncoded(const std::string& text);

}  // namespace terraport
