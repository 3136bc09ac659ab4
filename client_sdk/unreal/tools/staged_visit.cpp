#include "staged_visit.h"

#include <algorithm>
#include <chrono>
#include <utility>
#include <vector>

#include "Manifest.h"
#include "Terraport/DecodeThreads.h"
#include "Terraport/GroupFollower.h"
#include "Terraport/SceneLoader.h"
#include "Terraport/SceneStage.h"
#include "Terraport/ShownGround.h"
#include "json_text.h"
#include "plain_http.h"
#include "recording_renderer.h"

namespace terraport::tools {
namespace {

/// What a frame gives the stage.
constexpr double kFrameMs = 2.0;
constexpr std::size_t kDecodeThreads = 2;
/// Small, so that small scenes have many.
constexpr std::uint32_t kBaseBlockFaces = 16;

double clockMs() {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

StageOptions smallBlocks() {
  StageOptions options;
  options.baseBlockFaces = kBaseBlockFaces;
  return options;
}

/// Of the ground that is made solid around feet.
constexpr double kSolidHalfM = 4.0;
constexpr std::size_t kSolidFaces = 4096;

/// Height of the highest solid face over a place; far below where there is none.
double solidHeight(const ShownGround& ground, const Vec3& place) {
  std::vector<float> solid;
  ground.gather(place, kSolidHalfM, kSolidFaces, solid);
  double highest = -1e6;
  for (std::size_t at = 0; at < solid.size(); at += 9) {
    const float* a = &solid[at];
    const double u[3] = {double{a[3]} - a[0], double{a[4]} - a[1], double{a[5]} - a[2]};
    const double v[3] = {double{a[6]} - a[0], double{a[7]} - a[1], double{a[8]} - a[2]};
    const double x = place.x - a[0];
    const double z = place.z - a[2];
    const double area = u[0] * v[2] - u[2] * v[0];
    const double beta = (x * v[2] - z * v[0]) / area;
    const double gamma = (u[0] * z - u[2] * x) / area;
    if (beta >= -1e-9 && gamma >= -1e-9 && beta + gamma <= 1.0 + 1e-9) {
      highest = std::max(highest, a[1] + beta * u[1] + gamma * v[1]);
    }
  }
  return highest;
}

}  // namespace

struct StagedVisit::Impl {
  Impl(ISceneStream& stream, SharedSceneFiles files)
      : ground(renderer),
        decoders(kDecodeThreads),
        stage(stream, std::move(files), ground, decoders, smallBlocks()),
        follower(stream, stage) {}

  RecordingRenderer renderer;
  ShownGround ground;
  DecodeThreads decoders;
  SceneStage stage;
  GroupFollower follower;
  JsonText feet;
};

SharedSceneFiles loadFiles(const std::string& sceneUrl, const std::string& token, std::string& failure) {
  PlainHttp http;
  SceneLoadOptions options;
  options.token = token;
  SceneLoader loader(http, sceneUrl, options);
  while (loader.pump() == LoadState::Loading) {
  }
  if (loader.state() == LoadState::Failed) {
    failure = "files: " + loader.status().code() + ": " + loader.status().text();
  }
  return loader.files();
}

SharedSceneFiles loadManifest(const std::string& sceneUrl, const std::string& token, std::string& failure) {
  PlainHttp http;
  HttpAnswer answer;
  http.poll(http.get(sceneUrl, token, std::size_t{4} << 20), answer);
  CheckedManifest checked;
  const Status status = readManifest(viewOf(answer.body), "", checked);
  if (!status.isOk()) {
    failure = "manifest: " + std::to_string(answer.status) + ": " + status.text();
    return nullptr;
  }
  auto files = std::make_shared<SceneFiles>();
  files->manifest = std::move(checked.manifest);
  return files;
}

StagedVisit::StagedVisit(ISceneStream& stream, SharedSceneFiles files)
    : impl_(std::make_unique<Impl>(stream, std::move(files))) {}

StagedVisit::~StagedVisit() = default;

std::int64_t StagedVisit::land(const Vec3& position, double radiusM, const LandOptions& options, double nowMs) {
  return impl_->stage.land(position, radiusM, options, nowMs);
}

void StagedVisit::aim(const Vec3& position, double radiusM) {
  impl_->stage.aim(position, radiusM);
}

void StagedVisit::handle(const StreamEvent& event) {
  impl_->stage.handle(event);
  impl_->follower.handle(event, clockMs());
}

void StagedVisit::frame() {
  impl_->stage.update(clockMs, kFrameMs);
  impl_->follower.update();
}

void StagedVisit::setFollows(bool follows) {
  impl_->follower.setFollows(follows);
}

bool StagedVisit::isShown() const {
  return impl_->stage.status().phase == LandingPhase::Shown;
}

void StagedVisit::stand(const Vec3& position) {
  GroundPoint point;
  if (!impl_->ground.groundAt(position, point)) {
    impl_->feet.null();
    return;
  }
  impl_->feet.open('[').number(point.position.y).integer(point.segment);
  impl_->feet.number(solidHeight(impl_->ground, point.position)).close(']');
}

std::string StagedVisit::describe() const {
  const RecordingRenderer& renderer = impl_->renderer;
  JsonText json;
  json.open('{').key("visible").integers({renderer.shown().begin(), renderer.shown().end()});
  json.key("hidden_base_faces").integers(renderer.hiddenFaces());
  json.key("swaps").integer(renderer.swaps()).key("digest").text(impl_->stage.visibleDigest().text());
  json.key("faults").open('[');
  for (const std::string& fault : renderer.faults()) {
    json.text(fault);
  }
  const std::string text = json.close(']').close('}').str();
  return text.substr(0, text.size() - 1) + ",\"feet\":[" + impl_->feet.str() + "]}";
}

}  // namespace terraport::tools
