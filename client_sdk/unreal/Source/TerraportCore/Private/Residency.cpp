#include "Residency.h"

#include <algorithm>
#include <utility>

namespace terraport {
namespace {

/// Segments that aims brought and that wait for spare room; beyond it the oldest goes.
constexpr std::size_t kMostPrefetched = 4096;

SegmentList sorted(SegmentList segments) {
  std::sort(segments.begin(), segments.end());
  segments.erase(std::unique(segments.begin(), segments.end()), segments.end());
  return segments;
}

}  // namespace

Residency::Residency(const ShelfLimits& limits) : shelf_(limits, [this](std::uint32_t segment) { return isNeeded(segment); }) {}

bool Residency::isBusy() const {
  const auto waits = [this](std::uint32_t segment) { return shelf_.stepOf(segment) == ShelfStep::Held; };
  return shelf_.inFlight() > 0 || shelf_.hasFrees() ||
      (newest_ && newest_->hasPlan && std::any_of(required_.begin(), required_.end(), waits)) ||
      (shelf_.hasSpareRoom() && std::any_of(prefetched_.begin(), prefetched_.end(), waits));
}

void Residency::land(std::int64_t landing, const Vec3& position, double radiusM, double nowMs) {
  newest_.emplace();
  newest_->landing = landing;
  newest_->position = position;
  newest_->radiusM = radiusM;
  newest_->requestedAtMs = nowMs;
  recompute();
}

void Residency::planned(const PlanFacts& plan, std::int64_t landing) {
  LandingRecord* const record = landingOf(landing);
  if (record == nullptr) {
    return;
  }
  record->planned(plan);
  for (const std::uint32_t segment : plan.keep) {
    shelf_.hold(segment, -1);
  }
  nearbyIds_ = {plan.nearby.begin(), plan.nearby.end()};
  setRequired(*record->expected());
  shelf_.freeUnneededMeshes();
}

void Residency::arrived(const SegmentFacts& facts, std::int64_t landing) {
  const bool isAimed = landing == kNoLanding;
  const std::int64_t newestNumber = newest_ ? newest_->landing : 0;
  if (shelf_.hold(facts.segment, isAimed ? newestNumber : -1)) {
    shelf_.forgive(facts.segment);
    recompute();
  }
  if (newest_) {
    newest_->arrived(facts);
  }
  if (isAimed && requiredRanks_.count(facts.segment) == 0) {
    if (prefetched_.size() == kMostPrefetched) {
      prefetched_.erase(prefetched_.begin());  // Its payload stays held.
    }
    prefetched_.push_back(facts.segment);
  }
}

void Residency::degraded(std::int64_t landing, const SegmentList& segments) {
  LandingRecord* const record = landingOf(landing);
  if (record != nullptr) {
    record->degrade(segments);
  }
  recompute();
}

void Residency::ready(std::int64_t landing, const SegmentList& visible, const SegmentList& missing, double elapsedMs,
    std::uint64_t payloadBytes) {
  LandingRecord* const record = landingOf(landing);
  if (record == nullptr) {
    return;
  }
  const bool isShown = record->shown == ShownExtent::Full && sorted(visible) == visible_;
  record->ready(visible, missing, elapsedMs, payloadBytes);
  // After a reconnect the same set may be declared once more.
  record->shown = isShown ? ShownExtent::Full : ShownExtent::Nothing;
  for (const std::uint32_t segment : visible) {
    shelf_.hold(segment, -1);
  }
  // In the plan's order, nearest first; what the plan did not name last.
  SegmentList required = visible;
  const auto rankOf = [this](std::uint32_t segment) {
    const auto entry = requiredRanks_.find(segment);
    return entry == requiredRanks_.end() ? required_.size() : entry->second;
  };
  std::stable_sort(required.begin(), required.end(), [&](std::uint32_t a, std::uint32_t b) { return rankOf(a) < rankOf(b); });
  setRequired(std::move(required));
  shelf_.freeUnneededMeshes();
}

void Residency::refused(std::int64_t landing, const std::string& message) {
  LandingRecord* const record = landingOf(landing);
  if (record != nullptr) {
    record->refuse(message);
    setRequired({});
    shelf_.freeUnneededMeshes();
  }
}

void Residency::dropped(const SegmentList& segments) {
  for (const std::uint32_t segment : segments) {
    shelf_.drop(segment);
  }
  recompute();
}

void Residency::versionChanged() {
  ++epoch_;
  shelf_.clear();
  prefetched_.clear();
  nearbyIds_.clear();
  if (newest_) {
    newest_->restart();
  }
  setRequired({});
}

void Residency::clearVisible() {
  visible_.clear();
  visibleIds_.clear();
  shelf_.trim();
  recompute();
}

void Residency::takeDecodes(std::vector<ResidencyRequest>& requests) {
  const auto requestDecode = [&](std::uint32_t segment) {
    if (shelf_.tryDecode(segment)) {
      requests.push_back({segment, epoch_});
    }
  };
  if (newest_ && newest_->hasPlan) {
    for (const std::uint32_t segment : required_) {
      if (!shelf_.hasRoom()) {
        return;
      }
      requestDecode(segment);
    }
  }
  // What finds no spare room waits for the next swap.
  std::size_t requested = 0;
  for (; requested < prefetched_.size() && shelf_.hasRoom() && shelf_.hasSpareRoom(); ++requested) {
    requestDecode(prefetched_[requested]);
  }
  prefetched_.erase(prefetched_.begin(), prefetched_.begin() + static_cast<std::ptrdiff_t>(requested));
}

bool Residency::decoded(std::uint32_t segment, std::uint32_t epoch, std::size_t bytes) {
  return epoch == epoch_ && shelf_.take(segment, bytes);
}

void Residency::decodeFailed(std::uint32_t segment, std::uint32_t epoch) {
  if (epoch == epoch_) {
    shelf_.fail(segment);
    recompute();
  }
}

void Residency::uploadFailed(std::uint32_t segment) {
  shelf_.fail(segment);
  recompute();
}

std::optional<std::uint32_t> Residency::nextUpload(const SegmentList& skipped) const {
  std::optional<std::uint32_t> best;
  std::size_t bestRank = 0;
  for (const std::uint32_t segment : shelf_.decodedSegments()) {
    if (std::find(skipped.begin(), skipped.end(), segment) != skipped.end()) {
      continue;
    }
    const auto entry = requiredRanks_.find(segment);
    const std::size_t rank = entry == requiredRanks_.end() ? required_.size() : entry->second;
    if (!best || rank < bestRank || (rank == bestRank && segment < *best)) {
      best = segment;
      bestRank = rank;
    }
  }
  return best;
}

PresentableExtent Residency::presentable() const {
  if (!newest_ || !coming_ || newest_->shown == ShownExtent::Full || newest_->target() == nullptr ||
      preparedRevision_ != comingRevision_) {
    return PresentableExtent::Nothing;
  }
  if (checkedShelf_ != shelf_.revision() || checkedComing_ != comingRevision_) {
    checkedShelf_ = shelf_.revision();
    checkedComing_ = comingRevision_;
    isComingDrawable_ = std::all_of(coming_->begin(), coming_->end(),
        [this](std::uint32_t segment) { return shelf_.stepOf(segment) == ShelfStep::Drawable; });
  }
  if (!isComingDrawable_) {
    return PresentableExtent::Nothing;
  }
  return newest_->isTargetWhole() ? PresentableExtent::Full : PresentableExtent::Degraded;
}

bool Residency::swap(ResidencySwap& out) {
  const PresentableExtent extent = presentable();
  if (extent == PresentableExtent::Nothing) {
    return false;
  }
  SegmentList visible = *coming_;
  const std::unordered_set<std::uint32_t> after(visible.begin(), visible.end());
  out = ResidencySwap();
  out.landing = newest_->landing;
  out.isDegraded = extent == PresentableExtent::Degraded;
  for (const std::uint32_t segment : visible) {
    if (visibleIds_.count(segment) == 0) {
      out.shown.push_back(segment);
    }
  }
  for (const std::uint32_t segment : visible_) {
    if (after.count(segment) == 0) {
      out.hidden.push_back(segment);
    }
  }
  newest_->shown = out.isDegraded ? ShownExtent::Degraded : ShownExtent::Full;
  visible_ = std::move(visible);
  visibleIds_ = after;
  const std::int64_t landing = newest_->landing;
  shelf_.freeLeftBehind(landing, {out.hidden.begin(), out.hidden.end()});
  const auto isOld = [&](std::uint32_t segment) { return !shelf_.isAimedSince(segment, landing); };
  prefetched_.erase(std::remove_if(prefetched_.begin(), prefetched_.end(), isOld), prefetched_.end());
  recompute();
  return true;
}

void Residency::settle(double nowMs) {
  if (newest_ && newest_->presentableMs < 0.0 && presentable() == PresentableExtent::Full) {
    newest_->presentableMs = nowMs - newest_->requestedAtMs;
  }
}

double Residency::fraction() const {
  return newest_ ? newest_->fraction([this](std::uint32_t segment) { return shelf_.stepOf(segment) == ShelfStep::Drawable; })
                 : 0.0;
}

SegmentList Residency::missing() const {
  if (!newest_) {
    return {};
  }
  SegmentList segments = newest_->missing;
  const SegmentList* declared = newest_->target();
  declared = declared != nullptr ? declared : newest_->expected();
  if (declared != nullptr) {
    for (const std::uint32_t segment : *declared) {
      if (shelf_.stepOf(segment) == ShelfStep::Failed) {
        segments.push_back(segment);
      }
    }
  }
  return sorted(std::move(segments));
}

LandingRecord* Residency::landingOf(std::int64_t landing) {
  return newest_ && newest_->landing == landing && !newest_->isRefused ? &*newest_ : nullptr;
}

bool Residency::isNeeded(std::uint32_t segment) const {
  return requiredRanks_.count(segment) != 0 || visibleIds_.count(segment) != 0 || nearbyIds_.count(segment) != 0;
}

void Residency::setRequired(SegmentList required) {
  required_ = std::move(required);
  requiredRanks_.clear();
  for (std::size_t rank = 0; rank < required_.size(); ++rank) {
    requiredRanks_.emplace(required_[rank], rank);
  }
  shelf_.trim();
  recompute();
}

void Residency::recompute() {
  std::optional<SegmentList> next;
  if (newest_ && newest_->shown != ShownExtent::Full) {
    const SegmentList* ids = newest_->target();
    ids = ids != nullptr ? ids : newest_->expected();
    if (ids != nullptr) {
      next.emplace();
      for (const std::uint32_t segment : *ids) {
        if (shelf_.stepOf(segment) != ShelfStep::Failed) {
          next->push_back(segment);
        }
      }
      *next = sorted(std::move(*next));
    }
  }
  if (next != coming_) {
    coming_ = std::move(next);
    ++comingRevision_;
  }
}

}  // namespace terraport
