// Loads a version's files on a thread of its own: requests, hashes, decoding, and the arrays of the base.
#pragma once

#include <atomic>
#include <memory>
#include <string>
#include <thread>

#include "MeshArrays.h"
#include "Terraport/SceneFiles.h"
#include "Terraport/Status.h"

namespace terraport::godot {

struct LoadRequest {
  std::string url;
  std::string token;
  /// Empty for the newest.
  std::string version;
  std::uint32_t blockFaces = 2048;
  /// The one whose values are drawn; empty for none.
  std::string attribute;
};

struct LoadResult {
  Status status;
  std::string sceneUrl;
  SharedSceneFiles files;
  std::shared_ptr<const BaseParts> base;
};

/// One load. Destroying it gives it up and joins the thread: some milliseconds, or what decoding a base takes.
class Loading {
 public:
  explicit Loading(LoadRequest request);
  ~Loading();
  Loading(const Loading&) = delete;
  Loading& operator=(const Loading&) = delete;

  /// True once it is over; the result is moved out.
  bool poll(LoadResult& result);

 private:
  void run();

  const LoadRequest request_;
  LoadResult result_;
  std::atomic<bool> isStopping_{false};
  std::atomic<bool> isOver_{false};
  std::thread thread_;
};

}  // namespace terraport::godot
