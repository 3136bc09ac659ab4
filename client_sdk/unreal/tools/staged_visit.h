#pragma once

#include <memory>
#include <string>

#include "Terraport/SceneFiles.h"
#include "Terraport/SceneStream.h"
#include "Terraport/Types.h"

namespace terraport::tools {

/// Load the files of a scene; null, and `failure` set, where that cannot be.
SharedSceneFiles loadFiles(const std::string& sceneUrl, const std::string& token, std::string& failure);

/// Load its manifest alone, by one request.
SharedSceneFiles loadManifest(const std::string& sceneUrl, const std::string& token, std::string& failure);

/// A visit as an engine makes it: the scene's files are loaded, the stream's events go to a SceneStage, and a renderer that
/// draws nothing notes what would be drawn, and every order that a real one could not keep.
class StagedVisit {
 public:
  StagedVisit(ISceneStream& stream, SharedSceneFiles files);
  ~StagedVisit();

  std::int64_t land(const Vec3& position, double radiusM, const LandOptions& options, double nowMs);
  void aim(const Vec3& position, double radiusM);
  void handle(const StreamEvent& event);
  /// One frame of the engine.
  void frame();
  /// Whether landings of the group are followed; they are without this.
  void setFollows(bool follows);
  /// Whether the newest landing is what is drawn.
  bool isShown() const;
  /// Stand at a place: notes the height of the ground and its segment there; null where there is none.
  void stand(const Vec3& position);
  /// What is drawn, and what happened: one JSON object.
  std::string describe() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace terraport::tools
