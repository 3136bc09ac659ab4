#include "Terraport/SceneFiles.h"

namespace terraport {

Vec3 toSurvey(const SceneManifest& manifest, const Vec3& position) {
  return {manifest.origin[0] + position.x, manifest.origin[1] - position.z, manifest.origin[2] + position.y};
}

Vec3 fromSurvey(const SceneManifest& manifest, const Vec3& survey) {
  // Not -(n - n0): that would make a minus zero of the origin itself.
  return {survey.x - manifest.origin[0], survey.z - manifest.origin[2], manifest.origin[1] - survey.y};
}

}  // namespace terraport
