#pragma once

#include "Terraport/Api.h"
#include "Terraport/Status.h"

#include <string>

namespace terraport {

/// Where a server, and perhaps one scene of it, is (wire protocol, section 2.1).
struct SceneUrl {
  /// `http(s)://host[:port][/prefix]` without a slash at the end.
  std::string server;
  /// Scene id, decoded; empty for a server URL, whose only scene is meant.
  std::string scene;
};

/// Read a scene URL or a server URL, in every form that a user may paste: http(s) or ws(s), with a slash or `/stream` at the
/// end. Error code: `invalid_url`, if it is neither, or has credentials, a query or a fragment.
TERRAPORTCORE_API Result<SceneUrl> parseSceneUrl(const std::string& url);

/// The URL of one scene, `http(s)://.../scenes/{id}`. `serverUrl` may be the URL of another scene of the server.
/// Error code: `invalid_url`.
TERRAPORTCORE_API Result<std::string> sceneUrlOf(const std::string& serverUrl, const std::string& id);

/// Address of a scene's WebSocket. Error code: `invalid_url`, if the URL names no scene.
TERRAPORTCORE_API Result<std::string> streamUrl(const std::string& sceneUrl);

}  // namespace terraport
