#pragma once

#include "Terraport/Api.h"
#include "Terraport/Types.h"

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

namespace terraport {

/// What a stream is made of. Every bound has a default.
struct StreamOptions {
  /// URL of the scene, `http`, `https`, `ws` or `wss`, ending in `/scenes/{id}`.
  std::string sceneUrl;
  /// Bearer token; empty for none. Never put into a URL, never logged.
  std::string token;
  /// Asked for the present token before each connection, in place of `token`, and once more where that was refused after a
  /// welcome: with another one the session goes on, with everything held. Called on the thread that pumps the stream
  /// (`StreamThread`'s is its own); it must not wait, nor call the stream.
  std::function<std::string()> tokenProvider;
  /// Hard bounds of every landing.
  Budgets budgets;
  /// Payload bytes kept in memory beside what is shown or on its way; the least recently used go first.
  std::uint64_t cacheBytes = 96ull * 1024 * 1024;
  /// Folder (UTF-8) in which payloads are kept from one run to the next, shared by all scenes; empty for none. Whoever may read
  /// it may read the surveys. What cannot be kept there (a full disk, no such folder) is not; nothing fails. It takes a thread.
  std::string diskFolder;
  /// Bytes kept there, over all scenes; what was used longest ago goes first.
  std::uint64_t diskBytes = std::uint64_t{1024} * 1024 * 1024;
  /// Payload bytes under way at most: they bound what lies in buffers when a landing is superseded.
  std::uint64_t creditBytes = 16ull * 1024 * 1024;
  /// Release radius / load radius, 1 to 4; absent takes the server's.
  std::optional<double> releaseFactor;
  /// Name and version of the client, for the server's logs; at most 128 characters.
  std::string client = "terraport-unreal";
};

}  // namespace terraport
