// Which segments the renderer has, which it should have, and when the visible set may change.
//
// A segment goes Held (its payload is here) -> Decoding -> Decoded (waiting for, or under, upload) -> Uploaded -> Drawable, and
// from each of them back. What is *visible* is another matter: it changes in Residency::swap alone, to exactly what the newest
// landing's `ready` or `degraded` said. (One exception, where there is no choice: a new scene version.)
#pragma once

#include <cstdint>
#include <optional>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "LandingRecord.h"
#include "SegmentShelf.h"
#include "Terraport/Types.h"

namespace terraport {

/// What one swap changed; lists are ascending.
struct ResidencySwap {
  std::int64_t landing = kNoLanding;
  bool isDegraded = false;
  SegmentList shown;
  SegmentList hidden;
};

/// A segment to be decoded; `epoch` is given back with the answer.
struct ResidencyRequest {
  std::uint32_t segment = 0;
  std::uint32_t epoch = 0;
};

/// How much of the newest landing a swap would show.
enum class PresentableExtent : std::uint8_t { Nothing, Degraded, Full };

/// The segments of one stage. No I/O, no clock: whoever owns it decodes, uploads, frees, and says so. A call is a step, in
/// whatever order events come.
class Residency {
 public:
  explicit Residency(const ShelfLimits& limits);
  Residency(const Residency&) = delete;
  Residency& operator=(const Residency&) = delete;

  /// Segments shown, ascending.
  const SegmentList& visible() const { return visible_; }
  bool isVisible(std::uint32_t segment) const { return visibleIds_.count(segment) != 0; }
  /// The newest landing, or null before the first.
  const LandingRecord* newest() const { return newest_ ? &*newest_ : nullptr; }
  /// Number of this scene version, from 0: answers to requests of an earlier one are dropped.
  std::uint32_t epoch() const { return epoch_; }
  std::size_t inFlight() const { return shelf_.inFlight(); }
  std::size_t spareBytes() const { return shelf_.spareBytes(); }
  ShelfStep stepOf(std::uint32_t segment) const { return shelf_.stepOf(segment); }
  /// Whether there is something to decode, upload or free now, or on its way.
  bool isBusy() const;

  /// What the next swap will show as far as known, ascending, for the base to be prepared; null where nothing is coming.
  const SegmentList* coming() const { return coming_ ? &*coming_ : nullptr; }
  /// Changes whenever `coming` does.
  std::uint64_t comingRevision() const { return comingRevision_; }

  /// A landing was asked for: it is the newest from now on. What the one before requires is kept until the plan is here, since
  /// a short hop requires most of it again.
  void land(std::int64_t landing, const Vec3& position, double radiusM, double nowMs);
  /// Its plan came; once more after a reconnect.
  void planned(const PlanFacts& plan, std::int64_t landing);
  /// A segment's payload is here: for a landing, or (kNoLanding) for an aim.
  void arrived(const SegmentFacts& facts, std::int64_t landing);
  /// The deadline passed: these may be shown before the rest.
  void degraded(std::int64_t landing, const SegmentList& segments);
  /// Every byte is here: exactly these are to be shown.
  void ready(std::int64_t landing, const SegmentList& visible, const SegmentList& missing, double elapsedMs,
      std::uint64_t payloadBytes);
  /// The server said no to a landing: what is shown stays.
  void refused(std::int64_t landing, const std::string& message);
  /// The cache let these go: they cannot be decoded any more. What is uploaded stays.
  void dropped(const SegmentList& segments);
  /// Another scene version: ids mean other segments now. Everything is forgotten but `visible`, until `clearVisible`. Nothing
  /// is put on the list of what is to be freed.
  void versionChanged();
  /// The base of the new version is here: nothing of the old one is shown any more.
  void clearVisible();

  /// Append what to decode now, most urgent first; marks it so.
  void takeDecodes(std::vector<ResidencyRequest>& requests);
  /// A mesh came that will take `bytes` at the renderer. False where nobody wants it any more: throw it away.
  bool decoded(std::uint32_t segment, std::uint32_t epoch, std::size_t bytes);
  /// It could not be decoded: its base faces stay, and it is reported as missing.
  void decodeFailed(std::uint32_t segment, std::uint32_t epoch);
  /// The most urgent mesh that waits for its upload, or is in the middle of it, but for those of `skipped`.
  std::optional<std::uint32_t> nextUpload(const SegmentList& skipped) const;
  void uploaded(std::uint32_t segment) { shelf_.uploaded(segment); }
  void uploadFailed(std::uint32_t segment);
  void drawable(std::uint32_t segment) { shelf_.drawable(segment); }
  /// The base's hidden faces for the coming set of this revision are ready too.
  void basePrepared(std::uint64_t revision) { preparedRevision_ = revision; }
  std::vector<std::uint32_t> takeFreed() { return shelf_.takeFreed(); }

  /// What a swap would show.
  PresentableExtent presentable() const;
  /// Show what is presentable; false where nothing is. The one place where the visible set changes.
  bool swap(ResidencySwap& out);
  /// To be called once a frame: notes when the newest landing became presentable in full.
  void settle(double nowMs);

  /// Share of the newest landing that came and was uploaded, 0 to 1.
  double fraction() const;
  /// What the newest landing's full set lacks: reported missing by the stream, or not decodable. Ascending.
  SegmentList missing() const;

 private:
  LandingRecord* landingOf(std::int64_t landing);
  void setRequired(SegmentList required);
  void recompute();
  bool isNeeded(std::uint32_t segment) const;

  SegmentShelf shelf_;
  SegmentList visible_;
  std::unordered_set<std::uint32_t> visibleIds_;
  /// What the newest landing is to show, in the plan's order, nearest first; and the rank of each id in it.
  SegmentList required_;
  std::unordered_map<std::uint32_t, std::size_t> requiredRanks_;
  /// What the newest plan keeps ready beside what is shown.
  std::unordered_set<std::uint32_t> nearbyIds_;
  SegmentList prefetched_;
  std::optional<LandingRecord> newest_;
  std::optional<SegmentList> coming_;
  std::uint64_t comingRevision_ = 1;
  std::uint64_t preparedRevision_ = 0;
  std::uint32_t epoch_ = 0;
  /// Whether all that is coming is drawable, for these revisions: asked several times a frame.
  mutable std::uint64_t checkedShelf_ = 0;
  mutable std::uint64_t checkedComing_ = 0;
  mutable bool isComingDrawable_ = false;
};

}  // namespace terraport
