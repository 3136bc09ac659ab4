#include "Core/Stage.h"

#include <algorithm>
#include <utility>

namespace terraport {
namespace {

/// Times the radius: as far as the coarser level is worth its bytes (docs/benchmarks.md).
constexpr double kCoarseReach = 3.0;
/// Segments being decoded, or decoded and not uploaded, at a time: bounds memory.
constexpr std::size_t kMaxInFlight = 16;
/// Segments freed in one frame.
constexpr std::size_t kMaxFrees = 8;

std::size_t countOnes(const FaceBits& bits) {
  std::size_t ones = 0;
  for (const std::uint8_t byte : bits) {
    for (unsigned rest = byte; rest != 0; rest &= rest - 1) ++ones;
  }
  return ones;
}

}  // namespace

DecodeResult runDecode(DecodeJob job, DiskCache& disk, SegmentDecoder& decoder, SegmentMesh& mesh, const Prepare& prepare) {
  DecodeResult result;
  const bool isFromDisk = job.payload == nullptr;
  if (isFromDisk) job.payload = disk.read(job.key, job.box);
  if (job.payload == nullptr) {
    result.status = Status::failed("lost", "a file of the disk cache is gone");
  } else {
    result.status = decoder.decode(*job.payload, job.scene->attributes.size(), SegmentDecoder::Kind::Segment, mesh);
  }
  if (!result.status.isOk()) {
    if (isFromDisk) disk.remove(job.key, job.box);
  } else {
    job.box = mesh.bounds;
    if (job.isNew) result.isStored = disk.write({job.key, job.box, job.payload}, result.removed);
    if (job.isWanted) {
      result.prepared = prepare(mesh, *job.payload, *job.scene);
      result.prepared->ground = std::make_shared<const GroundMesh>(mesh);
      result.prepared->faces = mesh.faceCount;
    }
  }
  // A file that cannot be used is no failure of the service: the caller asks for it as for one that is gone.
  if (isFromDisk && !result.status.isOk()) job.payload = nullptr;
  result.job = std::move(job);
  return result;
}

void Stage::setScene(SharedScene scene, SharedGround base) {
  if (version_.empty()) version_ = scene->version;
  scene_ = std::move(scene);
  newBase_ = std::move(base);
  isBaseShown_ = false;
}

std::int64_t Stage::land(const Vec3& position, double radiusM, const LandOptions& options, double nowMs) {
  Place place{position, radiusM, options.coarseRadiusM, options.innerRadiusM};
  if (!place.coarseRadiusM && showsCoarse_ && scene_ && scene_->levels > 1) {
    place.coarseRadiusM = std::min(radiusM * kCoarseReach, std::max(maxRadiusM_, radiusM));
  }
  const std::int64_t landing = session_.land(place);
  if (landing < 0) return landing;
  options_ = options;
  begin(landing, nowMs);
  return landing;
}

/// The landing has been asked for, or is asked for anew.
void Stage::begin(std::int64_t landing, double nowMs) {
  target_.reset();
  status_ = LandingStatus();
  status_.landing = landing;
  status_.phase = LandingPhase::Planning;
  landedAtMs_ = progressAtMs_ = nowMs;
  isHurried_ = false;
}

bool Stage::aim(const Vec3& position, double radiusM) {
  Place place{position, radiusM, std::nullopt, std::nullopt};
  if (showsCoarse_ && scene_ && scene_->levels > 1) place.coarseRadiusM = radiusM * kCoarseReach;
  return session_.aim(place);
}

void Stage::handle(const Event& event, double nowMs) {
  if (const auto* opened = std::get_if<Opened>(&event)) {
    version_ = opened->scene.version;
    maxRadiusM_ = opened->limits.maxRadiusM;
    if (opened->versionChanged) {  // The user stands where they landed last: what belongs there now is asked for.
      target_.reset();
      session_.landAgain();
      if (session_.isLanding() && status_.phase != LandingPhase::Refused) begin(status_.landing, nowMs);
    }
  } else if (const auto* planned = std::get_if<Planned>(&event)) {
    askFor(*planned);
  } else if (const auto* came = std::get_if<SegmentCame>(&event)) {
    progressAtMs_ = nowMs;
    jobs_.push_back({came->key, came->payload, {}, true, false, nullptr});
  } else if (const auto* restore = std::get_if<RestoreNeeded>(&event)) {
    jobs_.push_back({restore->key, nullptr, restore->box, false, false, nullptr});
  } else if (const auto* inner = std::get_if<InnerComplete>(&event)) {
    setTarget(inner->landing, true, inner->rows, inner->hidden);
  } else if (const auto* complete = std::get_if<Complete>(&event)) {
    setTarget(complete->landing, false, complete->rows, complete->hidden);
    if (complete->landing == status_.landing) status_.readyMs = nowMs - landedAtMs_;
  } else if (const auto* refused = std::get_if<Refused>(&event)) {
    if (refused->landing == status_.landing && refused->landing != 0) {
      status_.phase = LandingPhase::Refused;
      status_.refusal = refused->message;
    }
  }
}

/// A newer landing ends what was to be shown of an older one, unless it was refused.
void Stage::setTarget(std::int64_t landing, bool isInner, const std::vector<SegmentRow>& rows, const FaceBits& hidden) {
  if (landing < status_.landing && status_.phase != LandingPhase::Refused) return;
  target_ = Target{landing, isInner, rows, hidden, false};
}

void Stage::askFor(const Planned& planned) {
  wanted_.clear();
  order_ = planned.plan.show;
  for (const SegmentRow& row : order_) {
    wanted_[row.key] = row;
    const CachedSegment* cached = session_.cached(row.key);
    if (cached != nullptr && pieces_.count(row.key) == 0) {
      jobs_.push_back({row.key, cached->payload, cached->box, false, false, nullptr});
    }
  }
  if (planned.landing == status_.landing) status_.phase = LandingPhase::Loading;
}

/// Nothing is decoded while the connection's scene is still loading: how many attributes there are is of a version.
void Stage::pushJobs() {
  const auto isPrepared = [](const auto& entry) { return entry.second.state == PieceState::Prepared; };
  const auto prepared = static_cast<std::size_t>(std::count_if(pieces_.begin(), pieces_.end(), isPrepared));
  while (!needsScene() && inFlight_ + prepared < kMaxInFlight && !jobs_.empty()) {
    DecodeJob job = std::move(jobs_.front());
    jobs_.pop_front();
    job.isWanted = wanted_.count(job.key) > 0 && pieces_.count(job.key) == 0;
    const bool isKnown = !job.isNew && job.payload != nullptr;
    if (isKnown && !job.isWanted) continue;  // Of a landing that was superseded meanwhile.
    job.scene = scene_;
    ++inFlight_;
    decoder_.push(std::move(job));
  }
}

void Stage::takeResults(double nowMs) {
  DecodeResult result;
  while (decoder_.tryPop(result)) {
    --inFlight_;
    progressAtMs_ = nowMs;
    const DecodeJob& job = result.job;
    const bool isKnown = session_.cached(job.key) != nullptr && !job.isNew;
    const bool isOfThisVersion = job.scene->version == version_;
    if (!isOfThisVersion) result.prepared.reset();  // Its colours are of the other version's regions.
    if (!result.status.isOk()) {
      if (!isOfThisVersion) {  // With another number of attributes; it may be good.
        jobs_.push_back(std::move(result.job));
      } else if (isKnown) {
        pieces_[job.key].state = PieceState::Failed;  // It was decoded once; memory is damaged.
      } else {
        job.payload == nullptr ? session_.lost(job.key) : session_.damaged(job.key);
      }
      continue;
    }
    if (result.isStored || !result.removed.empty()) {
      const CachedSegment stored{job.key, job.box, job.payload};
      session_.diskChanged(result.isStored ? std::optional<CachedSegment>(stored) : std::nullopt, result.removed);
    }
    if (!isKnown) session_.decoded(job.key, job.box, job.payload);
    if (wanted_.count(job.key) == 0 || pieces_.count(job.key) > 0) continue;
    if (result.prepared == nullptr) {  // It came for an aim, or for another version, and a landing wants it now.
      jobs_.push_back({job.key, job.payload, job.box, false, false, nullptr});
      continue;
    }
    Piece& piece = pieces_[job.key];
    piece.ground = result.prepared->ground;
    piece.gpuBytes = result.prepared->gpuBytes;
    piece.faces = result.prepared->faces;
    piece.prepared = std::move(result.prepared);
  }
}

void Stage::update(const std::function<double()>& clockMs, double budgetMs) {
  const double startMs = clockMs();
  watchDeadline(startMs);
  takeResults(startMs);
  pushJobs();
  for (auto& [key, piece] : pieces_) {
    if (piece.state == PieceState::Uploaded && renderer_.isDrawable(key)) piece.state = PieceState::Drawable;
  }
  freeSome();
  // One step at least, or a frame that is late already would never get on.
  bool isFirst = true;
  while (isFirst || clockMs() - startMs < budgetMs) {
    isFirst = false;
    if (newBase_ && renderer_.stepNewBase()) continue;
    if (newBase_) showNewBase();
    if (isBaseShown_ && target_ && !target_->isBasePrepared && !needsScene()) {
      if (renderer_.stepBase(target_->hidden)) continue;
      target_->isBasePrepared = true;
    }
    if (!uploadOne()) break;
  }
  updateStatus(clockMs());
  if (isAutoShow_ && isPresentable()) show();
}

/// The next piece of the newest plan, nearest first.
bool Stage::uploadOne() {
  for (const SegmentRow& row : order_) {
    const auto found = pieces_.find(row.key);
    if (found == pieces_.end() || found->second.state != PieceState::Prepared) continue;
    Piece& piece = found->second;
    piece.isBegun = true;
    const Renderer::UploadState state = renderer_.upload(row.key, *piece.prepared);
    if (state == Renderer::UploadState::More) return true;
    piece.prepared.reset();
    piece.state = state == Renderer::UploadState::Done ? PieceState::Uploaded : PieceState::Failed;
    return true;
  }
  return false;
}

void Stage::freeSome() {
  std::size_t freed = 0;
  for (auto entry = pieces_.begin(); entry != pieces_.end() && freed < kMaxFrees;) {
    if (isNeeded(entry->first)) {
      ++entry;
      continue;
    }
    if (entry->second.isBegun) renderer_.free(entry->first);
    entry = pieces_.erase(entry);
    ++freed;
  }
}

/// The new base replaces the one before with all that was shown: hidden faces are of one base.
void Stage::showNewBase() {
  Swap change;
  for (const auto& [key, row] : visible_) {
    (void)row;
    change.hidden.push_back(key);
  }
  visible_.clear();
  hiddenFaces_.clear();
  renderer_.showBase();
  if (!change.hidden.empty()) renderer_.swap(change);
  base_ = std::move(newBase_);
  newBase_.reset();
  isBaseShown_ = true;
  setGround();
}

bool Stage::isPresentable() const {
  if (!target_ || !target_->isBasePrepared || needsScene()) return false;
  return std::all_of(target_->rows.begin(), target_->rows.end(), [this](const SegmentRow& row) {
    const Piece* const found = piece(row.key);
    return found != nullptr && (found->state == PieceState::Drawable || found->state == PieceState::Failed);
  });
}

bool Stage::show() {
  if (!isPresentable()) return false;
  Swap change{target_->landing, target_->isInner, {}, {}, target_->hidden};
  std::map<Key, SegmentRow> next;
  for (const SegmentRow& row : target_->rows) {
    next[row.key] = row;
    if (visible_.count(row.key) == 0) change.shown.push_back(row.key);
  }
  for (const auto& [key, row] : visible_) {
    (void)row;
    if (next.count(key) == 0) change.hidden.push_back(key);
  }
  visible_ = std::move(next);
  hiddenFaces_ = target_->hidden;
  if (target_->landing == status_.landing) status_.phase = target_->isInner ? LandingPhase::ShownInner : LandingPhase::Shown;
  target_.reset();
  renderer_.swap(change);
  setGround();
  swaps_.push_back(std::move(change));
  return true;
}

void Stage::setGround() {
  std::map<Key, ShownGround::Piece> shown;
  for (const auto& [key, row] : visible_) {
    const Piece* const found = piece(key);
    if (found != nullptr) shown[key] = {row.id, found->ground};
  }
  ground_.set(base_, hiddenFaces_, std::move(shown));
}

void Stage::watchDeadline(double nowMs) {
  if (isHurried_ || !options_.innerRadiusM || !session_.isLanding()) return;
  const bool isLate = options_.deadlineMs > 0 && nowMs - landedAtMs_ >= options_.deadlineMs;
  const bool isStalled = options_.stallMs > 0 && nowMs - progressAtMs_ >= options_.stallMs;
  if (!isLate && !isStalled) return;
  isHurried_ = true;
  session_.hurry(status_.landing);
}

void Stage::updateStatus(double nowMs) {
  if (target_ && target_->landing == status_.landing && isPresentable()) {
    status_.phase = target_->isInner ? LandingPhase::PresentableInner : LandingPhase::Presentable;
    if (!target_->isInner && status_.presentableMs < 0) status_.presentableMs = nowMs - landedAtMs_;
  }
  if (status_.phase < LandingPhase::Loading || status_.phase == LandingPhase::Refused) return;
  std::size_t steps = 0;
  for (const auto& [key, row] : wanted_) {
    (void)row;
    const Piece* const found = piece(key);
    steps += (session_.cached(key) != nullptr ? 1 : 0) + (found != nullptr && found->state >= PieceState::Drawable ? 1 : 0);
  }
  status_.fraction = wanted_.empty() ? 1.0 : static_cast<double>(steps) / static_cast<double>(2 * wanted_.size());
}

StageStats Stage::stats() const {
  StageStats stats;
  stats.segments = pieces_.size();
  stats.visibleSegments = visible_.size();
  for (const auto& [key, piece] : pieces_) {
    if (piece.isBegun) stats.gpuBytes += piece.gpuBytes;
    if (visible_.count(key) > 0 && piece.state != PieceState::Failed) stats.visibleTriangles += piece.faces;
  }
  if (base_) stats.visibleTriangles += base_->faceCount() - countOnes(hiddenFaces_);
  return stats;
}

const Stage::Piece* Stage::piece(Key key) const {
  const auto found = pieces_.find(key);
  return found == pieces_.end() ? nullptr : &found->second;
}

}  // namespace terraport
