// Loads what is needed once for a version of a scene: manifest, base mesh, cover, names of the regions.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "Terraport/Api.h"
#include "Terraport/Http.h"
#include "Terraport/SceneFiles.h"
#include "Terraport/Status.h"

namespace terraport {

/// How a scene is loaded.
struct SceneLoadOptions {
  /// Bearer token; empty for none.
  std::string token;
  /// Scene version, 32 hexadecimal digits; empty for the newest.
  std::string version;
  /// Runs work that takes tens of milliseconds (hash and decoding of the files) somewhere else than in `pump`, on any thread,
  /// some time; unset: in `pump`.
  std::function<void(std::function<void()>)> runElsewhere;
  /// Called with the files where they were decoded, before they become constant: an engine may put the base's faces into an
  /// order of its own here, with their cover rows.
  std::function<void(SceneFiles&)> afterLoad;
};

/// The files of a version as they came.
struct SceneFileBytes {
  SharedPayload baseGlb;
  SharedPayload baseCover;
  SharedPayload regionsJson;
  /// Null, or whatever came: damaged labels are no labels.
  SharedPayload labelsJson;
};

enum class LoadState : std::uint8_t { Loading, Done, Failed };

/// Loads one scene. Every file is compared with its hash; a scene that is published anew meanwhile is begun again, once.
///
/// Polled: `pump` is called until the state is not Loading, and never blocks. One thread; `http` must outlive it. Destroying it
/// cancels what is under way.
class TERRAPORTCORE_API SceneLoader {
 public:
  /// `url` is a scene URL; or a server URL, whose only scene is meant.
  SceneLoader(Http& http, const std::string& url, SceneLoadOptions options = {});
  ~SceneLoader();
  SceneLoader(const SceneLoader&) = delete;
  SceneLoader& operator=(const SceneLoader&) = delete;

  LoadState pump();
  LoadState state() const;
  /// Why it failed. Codes: those of the wire protocol where the server refuses; `unreachable` without an answer; `damaged`
  /// where what came is not what the manifest says; `unsupported_version`, `invalid_url`, `several_scenes`, `refused`.
  const Status& status() const;
  /// Null before Done.
  const SharedSceneFiles& files() const;
  /// `http(s)://.../scenes/{id}`; empty before it is known.
  const std::string& sceneUrl() const;
  /// Bytes of base mesh, cover and regions that have come, of all; 0 of 0 before the manifest.
  std::uint64_t doneBytes() const;
  std::uint64_t totalBytes() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

/// Turn a version's files into what a client needs: hashes, decoding, all checks. `manifestJson` is scene.json as it came; `id`
/// the scene's of the URL. What SceneLoader does when everything has come; pure, any thread.
TERRAPORTCORE_API Result<std::shared_ptr<SceneFiles>> decodeSceneFiles(
    ByteSpan manifestJson, const std::string& id, const SceneFileBytes& bytes);

}  // namespace terraport
