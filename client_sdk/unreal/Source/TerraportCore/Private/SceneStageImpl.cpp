#include "SceneStageImpl.h"

#include "Messages.generated.h"

#include <algorithm>
#include <utility>

namespace terraport {
namespace {

/// Times the radius: as far as the coarser level is worth its bytes (docs/benchmarks.md).
constexpr double kCoarseReach = 3.0;

ShelfLimits limitsOf(const StageOptions& options) {
  ShelfLimits limits;
  limits.maxInFlight = std::max<std::size_t>(options.maxInFlight, 1);
  limits.maxInFlightBytes = options.maxInFlightBytes;
  limits.spareBytes = options.spareGpuBytes;
  return limits;
}

}  // namespace

SceneStage::Impl::Impl(
    LandingStream& stream, SharedSceneFiles files, SceneRenderer& renderer, DecodeQueue& decoders, const StageOptions& options)
    : stream_(stream),
      autoShow_(options.autoShow),
      showsCoarse_(options.showsCoarse),
      renderer_(renderer),
      decoders_(decoders),
      options_(options),
      files_(std::move(files)),
      residency_(limitsOf(options)) {
  beginBase();
}

SceneStage::Impl::~Impl() {
  for (const auto& [segment, staged] : staged_) {
    if (staged.isBegun) {
      renderer_.free(segment);
    }
  }
}

std::int64_t SceneStage::Impl::land(const Vec3& position, double radiusM, const LandOptions& options, double nowMs) {
  LandOptions asked = options;
  if (!asked.coarseRadiusM) {
    asked.coarseRadiusM = ringOf(radiusM);
  }
  const std::int64_t landing = stream_.land(position, radiusM, asked);
  if (landing != kNoLanding) {
    residency_.land(landing, position, radiusM, nowMs);
  }
  return landing;
}

std::optional<double> SceneStage::Impl::ringOf(double radiusM) const {
  if (!showsCoarse_ || files_->manifest.levels < 2) {
    return std::nullopt;
  }
  return std::min(radiusM * kCoarseReach, limits::kMaxRadiusM);
}

void SceneStage::Impl::handle(const StreamEvent& event) {
  switch (event.kind) {
    case EventKind::Opened:
      if (event.changed) {
        leaveVersion();
      }
      break;
    case EventKind::Planned:
      residency_.planned(event.plan, event.landing);
      break;
    case EventKind::Arrived:
      residency_.arrived(event.facts, event.landing);
      break;
    case EventKind::Degraded:
      residency_.degraded(event.landing, event.segments);
      break;
    case EventKind::Ready:
      residency_.ready(event.landing, event.segments, event.missing, event.elapsedMs, event.payloadBytes);
      break;
    case EventKind::Refused:
      if (event.landing != kNoLanding) {
        residency_.refused(event.landing, event.message);
      }
      break;
    case EventKind::Dropped:
      residency_.dropped(event.segments);
      break;
    default:
      break;
  }
}

void SceneStage::Impl::update(const std::function<double()>& clockMs, double budgetMs) {
  // What went on since the last frame is taken in first, so that the budget goes to what is still missing. The swap comes
  // last: it costs the renderer little and is not cut off by the budget.
  const double startMs = clockMs();
  endWarming();
  isBaseReady_ = isBaseReady_ || renderer_.isBaseReady();
  takeDecoded();
  if (!isOldVersion_) {
    askForDecodes();
  }
  freeSome();
  prepareBase();
  unfinished_.clear();
  std::size_t bytes = 0;
  // One step at least, or a frame that is late already would never get on.
  bool isFirst = true;
  // What is ready is handed on before anything more is decoded in this thread.
  while (bytes < options_.maxFrameBytes && (isFirst || clockMs() - startMs < budgetMs)) {
    isFirst = false;
    if (base_.step(renderer_) || uploadStep(bytes)) {
      continue;
    }
    if (!decoders_.step()) {
      break;
    }
    takeDecoded();
  }
  if (!isOldVersion_ && base_.preparedRevision() == residency_.comingRevision()) {
    residency_.basePrepared(base_.preparedRevision());
  }
  if (presentable() != PresentableExtent::Nothing) {
    residency_.settle(clockMs());
    if (autoShow_) {
      show();
    }
  }
}

bool SceneStage::Impl::show() {
  ResidencySwap change;
  if (presentable() == PresentableExtent::Nothing || !residency_.swap(change)) {
    return false;
  }
  SceneSwap swap;
  swap.landing = change.landing;
  swap.degraded = change.isDegraded;
  swap.shown = std::move(change.shown);
  swap.hidden = std::move(change.hidden);
  base_.flip(swap);
  segmentsHash_ = 0;
  for (const std::uint32_t segment : residency_.visible()) {
    segmentsHash_ ^= mix32(segment);
  }
  renderer_.swap(swap);
  if (onSwap_) {
    onSwap_(swap);
  }
  return true;
}

void SceneStage::Impl::beginBase() {
  // Files that were loaded have a whole cover; one that is none hides nothing.
  const Status status = base_.begin(*files_, options_.baseBlockFaces);
  (void)status.isOk();
  isBaseReady_ = false;
  renderer_.beginBase(*files_);
}

void SceneStage::Impl::leaveVersion() {
  // What is shown stays drawn until the new base is here; ids of the rest mean nothing any more.
  for (auto staged = staged_.begin(); staged != staged_.end();) {
    if (isOldVersion_ || residency_.isVisible(staged->first)) {
      ++staged;
      continue;
    }
    if (staged->second.isBegun) {
      renderer_.free(staged->first);
    }
    if (staged->second.mesh) {
      decoders_.release(std::move(staged->second.mesh));
    }
    staged = staged_.erase(staged);
  }
  warming_.clear();
  freeing_.clear();
  residency_.versionChanged();
  isOldVersion_ = true;
}

void SceneStage::Impl::replaceFiles(SharedSceneFiles files) {
  if (!isOldVersion_) {
    leaveVersion();
  }
  files_ = std::move(files);
  isOldVersion_ = false;
  for (auto& [segment, staged] : staged_) {
    if (staged.mesh) {
      decoders_.release(std::move(staged.mesh));
    }
  }
  // The renderer lets them go with the base that they belong to.
  staged_.clear();
  residency_.clearVisible();
  segmentsHash_ = 0;
  beginBase();
}

void SceneStage::Impl::askForDecodes() {
  requests_.clear();
  residency_.takeDecodes(requests_);
  for (const ResidencyRequest& request : requests_) {
    SharedPayload payload = stream_.payload(request.segment);
    if (!payload) {
      ++decodeFailures_;
      residency_.decodeFailed(request.segment, request.epoch);
      continue;
    }
    decoders_.push({request.segment, request.epoch, std::move(payload), files_});
  }
}

void SceneStage::Impl::takeDecoded() {
  DecodedSegment answer;
  while (decoders_.tryPop(answer)) {
    if (!answer.status.isOk() || !answer.mesh) {
      decodeFailures_ += answer.epoch == residency_.epoch() ? 1 : 0;
      residency_.decodeFailed(answer.segment, answer.epoch);
    } else if (const std::size_t bytes = renderer_.gpuBytesOf(*answer.mesh);
        residency_.decoded(answer.segment, answer.epoch, bytes)) {
      freeStaged(answer.segment);  // what was to be freed of it, and still waited for that
      StagedSegment& staged = staged_[answer.segment];
      staged.gpuBytes = bytes;
      staged.faces = answer.mesh->faceCount;
      staged.mesh = std::move(answer.mesh);
      staged.payload = std::move(answer.payload);
    }
    if (answer.mesh) {
      decoders_.release(std::move(answer.mesh));
    }
    answer = DecodedSegment();
  }
}

bool SceneStage::Impl::uploadStep(std::size_t& bytes) {
  const std::optional<std::uint32_t> segment = isOldVersion_ ? std::nullopt : residency_.nextUpload(unfinished_);
  if (!segment) {
    return false;
  }
  StagedSegment& staged = staged_[*segment];
  staged.isBegun = true;
  const ByteSpan payload = staged.payload ? viewOf(*staged.payload) : ByteSpan();
  const UploadState state = renderer_.upload(*segment, *staged.mesh, payload);
  if (state == UploadState::More) {
    // Its bytes count once, at the end.
    unfinished_.push_back(*segment);
    return true;
  }
  bytes += staged.gpuBytes;
  decoders_.release(std::move(staged.mesh));
  staged.payload.reset();
  if (state == UploadState::Failed) {
    ++decodeFailures_;
    renderer_.free(*segment);
    staged_.erase(*segment);
    residency_.uploadFailed(*segment);
    return true;
  }
  residency_.uploaded(*segment);
  warming_.push_back(*segment);
  return true;
}

void SceneStage::Impl::endWarming() {
  const auto isDone = [this](std::uint32_t segment) {
    if (residency_.stepOf(segment) != ShelfStep::Uploaded) {
      return true;  // freed meanwhile
    }
    if (!renderer_.isDrawable(segment)) {
      return false;
    }
    residency_.drawable(segment);
    return true;
  };
  warming_.erase(std::remove_if(warming_.begin(), warming_.end(), isDone), warming_.end());
}

void SceneStage::Impl::freeSome() {
  const SegmentList freed = residency_.takeFreed();
  freeing_.insert(freeing_.end(), freed.begin(), freed.end());
  const std::size_t count = std::min(std::max<std::size_t>(options_.maxFrameFrees, 1), freeing_.size());
  const SegmentList batch(freeing_.begin(), freeing_.begin() + static_cast<std::ptrdiff_t>(count));
  for (const std::uint32_t segment : batch) {
    freeStaged(segment);
  }
}

void SceneStage::Impl::freeStaged(std::uint32_t segment) {
  const auto queued = std::find(freeing_.begin(), freeing_.end(), segment);
  if (queued == freeing_.end()) {
    return;
  }
  freeing_.erase(queued);
  warming_.erase(std::remove(warming_.begin(), warming_.end(), segment), warming_.end());
  const auto staged = staged_.find(segment);
  if (staged == staged_.end()) {
    return;
  }
  if (staged->second.isBegun) {
    renderer_.free(segment);
  }
  if (staged->second.mesh) {
    decoders_.release(std::move(staged->second.mesh));
  }
  staged_.erase(staged);
}

void SceneStage::Impl::prepareBase() {
  const SegmentList* coming = isOldVersion_ ? nullptr : residency_.coming();
  if (coming != nullptr) {
    base_.prepare(*coming, residency_.comingRevision());
  }
}

}  // namespace terraport
