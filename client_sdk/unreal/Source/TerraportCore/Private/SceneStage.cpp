// The stage's public surface, its status and its counters.
#include "Terraport/SceneStage.h"

#include <cstdio>
#include <utility>

#include "SceneStageImpl.h"

namespace terraport {

std::string VisibleDigest::text() const {
  char buffer[64];
  std::snprintf(buffer, sizeof buffer, "%u:%x:%u:%x", segments, segmentsHash, hiddenBaseFaces, hiddenBaseHash);
  return buffer;
}

bool SceneStage::Impl::isBusy() const {
  const bool isBaseBehind = residency_.coming() != nullptr && base_.preparedRevision() != residency_.comingRevision();
  return !isBaseReady_ || !freeing_.empty() || !warming_.empty() || (!isOldVersion_ && (isBaseBehind || residency_.isBusy())) ||
      (autoShow_ && presentable() != PresentableExtent::Nothing);
}

LandingStatus SceneStage::Impl::status() const {
  LandingStatus status;
  const LandingRecord* newest = residency_.newest();
  if (newest == nullptr) {
    return status;
  }
  const PresentableExtent extent = presentable();
  if (newest->isRefused) {
    status.phase = LandingPhase::Refused;
  } else if (newest->shown == ShownExtent::Full) {
    status.phase = LandingPhase::Shown;
  } else if (extent != PresentableExtent::Nothing) {
    status.phase = extent == PresentableExtent::Full ? LandingPhase::Presentable : LandingPhase::PresentableDegraded;
  } else if (newest->shown == ShownExtent::Degraded) {
    status.phase = LandingPhase::ShownDegraded;
  } else {
    status.phase = newest->hasPlan ? LandingPhase::Loading : LandingPhase::Planning;
  }
  status.landing = newest->landing;
  status.position = newest->position;
  status.radiusM = newest->radiusM;
  status.effectiveRadiusM = newest->effectiveRadiusM;
  status.fraction = residency_.fraction();
  status.missing = residency_.missing();
  status.refusal = newest->refusal;
  status.readyMs = newest->readyMs;
  status.presentableMs = newest->presentableMs;
  status.payloadBytes = newest->payloadBytes;
  return status;
}

VisibleDigest SceneStage::Impl::visibleDigest() const {
  return {static_cast<std::uint32_t>(residency_.visible().size()), segmentsHash_, base_.hiddenCount(), base_.hiddenHash()};
}

StageStats SceneStage::Impl::stats() const {
  StageStats stats;
  for (const auto& [segment, staged] : staged_) {
    if (!staged.isBegun) {
      continue;
    }
    ++stats.segments;
    stats.gpuBytes += staged.gpuBytes;
    if (residency_.isVisible(segment)) {
      stats.visibleTriangles += staged.faces;
    }
  }
  stats.visibleSegments = residency_.visible().size();
  stats.visibleTriangles += files_->base.faceCount - base_.hiddenCount();
  stats.spareGpuBytes = residency_.spareBytes();
  stats.decodeFailures = decodeFailures_;
  return stats;
}

SceneStage::SceneStage(
    LandingStream& stream, SharedSceneFiles files, SceneRenderer& renderer, DecodeQueue& decoders, const StageOptions& options)
    : impl_(new Impl(stream, std::move(files), renderer, decoders, options)) {}

SceneStage::~SceneStage() = default;

std::int64_t SceneStage::land(const Vec3& position, double radiusM, const LandOptions& options, double nowMs) {
  return impl_->land(position, radiusM, options, nowMs);
}

void SceneStage::aim(const Vec3& position, double radiusM) {
  impl_->aim(position, radiusM);
}

void SceneStage::handle(const StreamEvent& event) {
  impl_->handle(event);
}

void SceneStage::update(const std::function<double()>& clockMs, double budgetMs) {
  impl_->update(clockMs, budgetMs);
}

bool SceneStage::isPresentable() const {
  return impl_->presentable() != PresentableExtent::Nothing;
}

bool SceneStage::show() {
  return impl_->show();
}

void SceneStage::setShowsCoarse(bool showsCoarse) {
  impl_->showsCoarse_ = showsCoarse;
}

void SceneStage::setAutoShow(bool autoShow) {
  impl_->autoShow_ = autoShow;
}

void SceneStage::replaceFiles(SharedSceneFiles files) {
  impl_->replaceFiles(std::move(files));
}

bool SceneStage::needsFiles() const {
  return impl_->isOldVersion_;
}

bool SceneStage::isBusy() const {
  return impl_->isBusy();
}

const std::vector<std::uint32_t>& SceneStage::visible() const {
  return impl_->residency().visible();
}

LandingStatus SceneStage::status() const {
  return impl_->status();
}

VisibleDigest SceneStage::visibleDigest() const {
  return impl_->visibleDigest();
}

StageStats SceneStage::stats() const {
  return impl_->stats();
}

const SceneFiles& SceneStage::files() const {
  return impl_->files();
}

void SceneStage::onSwap(std::function<void(const SceneSwap&)> listener) {
  impl_->onSwap_ = std::move(listener);
}

}  // namespace terraport
