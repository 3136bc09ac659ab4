// The client's memory of segments: a byte-bounded LRU with pins. Pure: "recently" is counted in accesses, not in time.
#pragma once

#include "Terraport/Types.h"

#include <cstdint>
#include <list>
#include <map>
#include <set>
#include <vector>

namespace terraport {

/// A payload with what is known of it.
struct CachedSegment {
  SegmentFacts facts;
  SharedPayload payload;
};

/// What is pinned (the visible segments, and those of a plan on its way) is never evicted; everything else goes, least
/// recently used first, as soon as the bound is exceeded. Pins may exceed the bound: a landing must be held whole, and its
/// size is bounded by the budgets of the landing instead.
class SegmentCache {
 public:
  /// `maxBytes` bounds the payload bytes beside what is pinned; 0 keeps pinned segments only.
  explicit SegmentCache(std::uint64_t maxBytes) : maxBytes_(maxBytes) {}

  /// Payload bytes held now, pinned ones included.
  std::uint64_t bytes() const { return bytes_; }
  std::size_t size() const { return index_.size(); }
  bool has(std::uint32_t segment) const { return index_.count(segment) != 0; }

  /// The entry, from now on the most recently used; null where there is none. Valid until the next change.
  const CachedSegment* get(std::uint32_t segment);

  /// The entry; its age does not change.
  const CachedSegment* peek(std::uint32_t segment) const;

  /// Add (or replace) a payload as the most recently used; evicts nothing. Eviction is a step of its own, `trim`: between a
  /// `land` and its `plan` nothing may be evicted, because the plan may count on it.
  void put(CachedSegment entry);

  /// Drop one entry, pinned or not; whether it was held.
  bool discard(std::uint32_t segment);

  /// Make exactly these ids the pinned ones.
  void pin(std::set<std::uint32_t> segments) { pinned_ = std::move(segments); }

  /// Evict unpinned entries, least recently used first, until the bound holds or none is left; in that order.
  std::vector<SegmentFacts> trim();

  /// Everything held, least recently used first.
  const std::list<CachedSegment>& entries() const { return entries_; }

 private:
  std::uint64_t maxBytes_;
  std::uint64_t bytes_ = 0;
  std::list<CachedSegment> entries_;
  // Trees, not hash tables: a server chooses the ids.
  std::map<std::uint32_t, std::list<CachedSegment>::iterator> index_;
  std::set<std::uint32_t> pinned_;
};

}  // namespace terraport
