// Where every known segment stands between payload and renderer, and what of it nobody needs.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "Terraport/Types.h"

namespace terraport {

/// How much is done at once, and kept.
struct ShelfLimits {
  /// Segments that are being decoded, or decoded and not yet uploaded, at a time.
  std::size_t maxInFlight = 16;
  /// GPU bytes of those, as far as can be told before they are decoded: bounds the memory beside the GPU's.
  std::size_t maxInFlightBytes = 0;
  /// GPU bytes of segments that are neither visible nor of the newest plan: what an aim brought.
  std::size_t spareBytes = 0;
};

/// How much is between a payload and the renderer. There is always room for one.
class InFlight {
 public:
  explicit InFlight(const ShelfLimits& limits) : limits_(limits) {}

  std::size_t count() const { return decoding_ + waiting_; }
  bool hasRoom() const;
  /// A segment was asked for.
  void ask() { ++decoding_; }
  /// It came, or not; it is not kept.
  void dismiss() { --decoding_; }
  /// It came, and waits.
  void wait(std::size_t bytes);
  /// It waits no longer.
  void leave(std::size_t bytes);
  /// Nothing that was asked for will be taken any more.
  void clear();

 private:
  ShelfLimits limits_;
  std::size_t decoding_ = 0;
  std::size_t waiting_ = 0;
  std::size_t waitingBytes_ = 0;
  /// GPU bytes that a segment is taken to have: at first between vertex colours and a large texture, then as those that came.
  double guessBytes_ = 6.0 * 1024 * 1024;
};

/// `Held`: the payload is here. `Decoded`: waits for, or under, upload. `Drawable`: can be drawn at once.
enum class ShelfStep : std::uint8_t { Unknown, Held, Decoding, Decoded, Uploaded, Drawable, Failed };

/// Segments by id. Which are needed is said from outside (Residency); what is not is *spare*, and bounded in bytes.
class SegmentShelf {
 public:
  /// `isNeeded` says whether a segment is visible, or required or kept nearby by the newest plan. After it changes: `trim`.
  SegmentShelf(const ShelfLimits& limits, std::function<bool(std::uint32_t)> isNeeded);

  std::size_t spareBytes() const { return spareBytes_; }
  /// Whether an aim's segment may be decoded now.
  bool hasSpareRoom() const { return spareBytes_ < limits_.spareBytes; }
  /// Segments being decoded, or decoded and not uploaded.
  std::size_t inFlight() const { return inFlight_.count(); }
  /// Whether one more may be decoded.
  bool hasRoom() const { return inFlight_.hasRoom(); }
  bool hasFrees() const { return !toFree_.empty(); }
  /// Changes whenever a step does.
  std::uint64_t revision() const { return revision_; }
  ShelfStep stepOf(std::uint32_t segment) const;
  /// Meshes that wait for their upload, in no order.
  const std::unordered_set<std::uint32_t>& decodedSegments() const { return decoded_; }

  /// A payload is here. `aimedDuring` is the newest landing if an aim brought it, else -1. True where it had failed before.
  bool hold(std::uint32_t segment, std::int64_t aimedDuring);
  /// It came once more: perhaps whole this time.
  void forgive(std::uint32_t segment);
  /// The payload is gone. What is uploaded stays; what is needed and not there counts as failed.
  void drop(std::uint32_t segment);
  /// Forget all, without freeing: the ids mean other segments from now on.
  void clear();
  /// Start decoding a held segment, if there is room.
  bool tryDecode(std::uint32_t segment);
  /// A mesh of that many GPU bytes came. False where nobody needs it, and it came for no aim, or there is no spare room.
  bool take(std::uint32_t segment, std::size_t bytes);
  /// Decoding or uploading failed: it counts as missing until it comes once more.
  void fail(std::uint32_t segment);
  void uploaded(std::uint32_t segment);
  void drawable(std::uint32_t segment);

  /// Meshes that wait, for no aim, and that nobody needs any more: they take memory and give nothing.
  void freeUnneededMeshes();
  /// After a swap: what it hid, and whatever came for earlier landings and aims.
  void freeLeftBehind(std::int64_t landing, const std::unordered_set<std::uint32_t>& hidden);
  /// Whether an aim brought it since this landing was asked for.
  bool isAimedSince(std::uint32_t segment, std::int64_t landing) const;
  /// Ids whose memory at the renderer, or waiting mesh, is to be freed; each is returned once.
  std::vector<std::uint32_t> takeFreed();
  /// Count what is spare anew, and free of it what was used longest ago until the rest fits.
  void trim();

 private:
  struct Entry {
    ShelfStep step = ShelfStep::Held;
    /// At the renderer, once decoded.
    std::size_t bytes = 0;
    /// Newest landing when an aim brought it, or -1: it came for a landing.
    std::int64_t aimedDuring = -1;
    /// When it came or was decoded, as a running number.
    std::uint64_t usedAt = 0;
  };

  Entry* find(std::uint32_t segment);
  void setStep(std::uint32_t segment, Entry& entry, ShelfStep step);
  void free(std::uint32_t segment, Entry& entry);
  template <typename IsToGo>
  void freeIf(IsToGo&& isToGo);

  ShelfLimits limits_;
  InFlight inFlight_;
  std::function<bool(std::uint32_t)> isNeeded_;
  std::unordered_map<std::uint32_t, Entry> entries_;
  std::unordered_set<std::uint32_t> decoded_;
  std::vector<std::uint32_t> toFree_;
  std::size_t spareBytes_ = 0;
  std::uint64_t tick_ = 0;
  std::uint64_t revision_ = 0;
};

}  // namespace terraport
