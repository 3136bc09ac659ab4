#include "Terraport/ShownGround.h"

#include <algorithm>
#include <unordered_map>
#include <utility>
#include <vector>

#include "GroundMesh.h"

namespace terraport {
namespace {

/// A ray that meets nothing sooner: farther than any scene, metres.
constexpr double kFarM = 1e8;

}  // namespace

SharedGround groundOf(const SegmentMesh& mesh) {
  return std::make_shared<const GroundMesh>(mesh);
}

struct ShownGround::Impl {
  Impl(SceneRenderer& renderer_, Made made_) : renderer(renderer_), made(std::move(made_)) {}

  SceneRenderer& renderer;
  const Made made;
  /// As the renderer has them, so bounded as these are: 24 bytes a face or so beside what is on the graphics card.
  std::unordered_map<std::uint32_t, SharedGround> meshes;
  std::unordered_map<std::uint32_t, SharedGround> shown;
  SharedGround prepared;
  /// Of the last `beginBase`, while the renderer still draws the one before.
  SharedGround coming;
  SharedGround drawn;
  /// Of that base: ids from here on are those of the coarser level.
  std::uint32_t segmentCount = 1;
  std::uint32_t comingSegmentCount = 1;
  std::vector<std::uint8_t> hidden;
  std::uint64_t changes = 0;
};

ShownGround::ShownGround(SceneRenderer& renderer, Made made) : impl_(std::make_unique<Impl>(renderer, std::move(made))) {}

ShownGround::~ShownGround() = default;

void ShownGround::setBase(SharedGround base) {
  impl_->prepared = std::move(base);
}

bool ShownGround::cast(const Vec3& origin, const Vec3& direction, double mostAt, GroundPoint& point) const {
  point = GroundPoint();
  point.at = mostAt;
  bool isMet =
      impl_->drawn && impl_->drawn->cast(origin, direction, impl_->hidden.empty() ? nullptr : impl_->hidden.data(), point);
  for (const auto& [segment, mesh] : impl_->shown) {
    if (mesh->cast(origin, direction, nullptr, point)) {
      point.segment = segment % impl_->segmentCount;
      isMet = true;
    }
  }
  return isMet;
}

bool ShownGround::groundAt(const Vec3& position, GroundPoint& point) const {
  return cast(position, {0.0, -1.0, 0.0}, kFarM, point) || cast(position, {0.0, 1.0, 0.0}, kFarM, point);
}

std::uint64_t ShownGround::changes() const {
  return impl_->changes;
}

double ShownGround::gather(const Vec3& centre, double halfM, std::size_t mostFaces, std::vector<float>& corners) const {
  const std::uint8_t* const hidden = impl_->hidden.empty() ? nullptr : impl_->hidden.data();
  for (int halving = 0; halving <= 4; ++halving, halfM /= 2) {
    corners.clear();
    bool isWhole = !impl_->drawn || impl_->drawn->gather(centre, halfM, hidden, 9 * mostFaces, corners);
    for (const auto& [segment, mesh] : impl_->shown) {
      (void)segment;
      isWhole = isWhole && mesh->gather(centre, halfM, nullptr, 9 * mostFaces, corners);
    }
    if (isWhole) {
      return halfM;
    }
  }
  corners.clear();
  return 0.0;
}

UploadState ShownGround::upload(std::uint32_t segment, const SegmentMesh& mesh, ByteSpan payload) {
  SharedGround& ground = impl_->meshes[segment];
  if (!ground && impl_->made) {
    ground = impl_->made(mesh);
  }
  if (!ground) {
    ground = groundOf(mesh);
  }
  const UploadState state = impl_->renderer.upload(segment, mesh, payload);
  if (state == UploadState::Failed) {
    impl_->meshes.erase(segment);
  }
  return state;
}

bool ShownGround::isDrawable(std::uint32_t segment) {
  return impl_->renderer.isDrawable(segment);
}

void ShownGround::free(std::uint32_t segment) {
  impl_->meshes.erase(segment);
  impl_->renderer.free(segment);
}

std::size_t ShownGround::gpuBytesOf(const SegmentMesh& mesh) const {
  return impl_->renderer.gpuBytesOf(mesh);
}

void ShownGround::beginBase(const SceneFiles& files) {
  impl_->coming = impl_->prepared ? std::move(impl_->prepared) : groundOf(files.base);
  impl_->prepared.reset();
  impl_->comingSegmentCount = std::max<std::uint32_t>(files.manifest.segmentCount, 1);
  // Ids mean other segments now; what is shown of the version before stays until its base goes.
  impl_->meshes.clear();
  impl_->renderer.beginBase(files);
}

void ShownGround::prepareBase(const FaceRange& block, const HiddenFaces& next) {
  impl_->renderer.prepareBase(block, next);
}

bool ShownGround::isBaseReady() {
  const bool isReady = impl_->renderer.isBaseReady();
  if (isReady && impl_->coming) {
    impl_->shown.clear();
    impl_->drawn = std::move(impl_->coming);
    impl_->coming.reset();
    impl_->segmentCount = impl_->comingSegmentCount;
    impl_->hidden.assign(impl_->drawn->faceCount(), 0);
    ++impl_->changes;
  }
  return isReady;
}

void ShownGround::swap(const SceneSwap& change) {
  for (const std::uint32_t segment : change.hidden) {
    impl_->shown.erase(segment);
  }
  for (const std::uint32_t segment : change.shown) {
    const auto entry = impl_->meshes.find(segment);
    if (entry != impl_->meshes.end()) {
      impl_->shown[segment] = entry->second;
    }
  }
  // A copy: the view is of the counters, which go ahead to the next landing.
  impl_->hidden.assign(change.baseHidden.faces, change.baseHidden.faces + change.baseHidden.faceCount);
  impl_->hidden.resize(impl_->drawn ? impl_->drawn->faceCount() : 0, 0);
  ++impl_->changes;
  impl_->renderer.swap(change);
}

}  // namespace terraport
