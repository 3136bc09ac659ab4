// Loads a scene's manifest, base and regions by HTTP.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "Core/Http.h"
#include "Core/Scene.h"
#include "Core/SceneUrl.h"

namespace terraport {

class SceneLoader {
 public:
  struct Options {
    /// Of a scene, or of a server that has one scene.
    std::string url;
    std::string token;
    /// Empty for the newest.
    std::string version;
    /// Runs work on another thread.
    std::function<void(std::function<void()>)> runElsewhere;
    /// Called there with the scene, last.
    std::function<void(Scene&)> afterLoad;
  };
  enum class State : std::uint8_t { Loading, Done, Failed };

  /// `http` outlives this.
  SceneLoader(Http& http, Options options);
  /// Cancels what is under way.
  ~SceneLoader();
  SceneLoader(const SceneLoader&) = delete;
  SceneLoader& operator=(const SceneLoader&) = delete;

  /// To be called in each frame while it loads.
  State pump();
  /// Why it failed.
  const Status& status() const { return status_; }
  const SharedScene& scene() const { return scene_; }
  const SceneUrl& url() const { return url_; }

 private:
  enum class Step : std::uint8_t { List, Manifest, Files };
  struct Request {
    std::string url;
    std::size_t maxBytes = 0;
    std::uint64_t number = 0;
    HttpAnswer answer;
  };
  /// What the other thread does; shared with it, since this may be gone first.
  struct Work;

  void begin(std::vector<std::pair<std::string, std::size_t>> files);
  void beginManifest();
  void advance();
  void fail(Status status);

  Http& http_;
  Options options_;
  SceneUrl url_;
  Step step_ = Step::List;
  std::vector<Request> requests_;
  /// The manifest was read, its files are coming; then the work under way.
  std::shared_ptr<Work> pending_, work_;
  State state_ = State::Loading;
  Status status_;
  SharedScene scene_;
};

}  // namespace terraport
