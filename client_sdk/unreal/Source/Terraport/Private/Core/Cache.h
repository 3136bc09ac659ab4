// Payloads in memory by key: least recently used first, bounded in bytes.
#pragma once

#include <cstdint>
#include <list>
#include <unordered_map>
#include <utility>

#include "Core/Basics.h"
#include "Core/Messages.h"

namespace terraport {

/// A payload that was decoded once: its checksums are right.
struct CachedSegment {
  Key key = 0;
  Box box;
  SharedBytes payload;
};

class SegmentCache {
 public:
  /// `maxBytes` bounds what `trim` leaves, beyond what it must keep.
  explicit SegmentCache(std::uint64_t maxBytes) : maxBytes_(maxBytes) {}

  std::uint64_t bytes() const { return bytes_; }
  bool isFull() const { return bytes_ > maxBytes_; }

  /// Least recently used first.
  const std::list<CachedSegment>& entries() const { return entries_; }

  const CachedSegment* find(Key key) const {
    const auto found = places_.find(key);
    return found == places_.end() ? nullptr : &*found->second;
  }

  /// As `find`, and the entry counts as used now.
  const CachedSegment* use(Key key) {
    const auto found = places_.find(key);
    if (found == places_.end()) return nullptr;
    entries_.splice(entries_.end(), entries_, found->second);
    return &*found->second;
  }

  /// Add or replace; evicts nothing.
  void put(CachedSegment entry) {
    remove(entry.key);
    bytes_ += entry.payload->size();
    const Key key = entry.key;
    places_[key] = entries_.insert(entries_.end(), std::move(entry));
  }

  void remove(Key key) {
    const auto found = places_.find(key);
    if (found == places_.end()) return;
    bytes_ -= found->second->payload->size();
    entries_.erase(found->second);
    places_.erase(found);
  }

  /// Evict until the bound holds, or nothing is left for which `isNeeded(key)` is false.
  template <typename IsNeeded>
  void trim(IsNeeded isNeeded) {
    for (auto entry = entries_.begin(); isFull() && entry != entries_.end();) {
      const Key key = entry->key;
      ++entry;
      if (!isNeeded(key)) remove(key);
    }
  }

 private:
  std::uint64_t maxBytes_;
  std::uint64_t bytes_ = 0;
  std::list<CachedSegment> entries_;
  std::unordered_map<Key, std::list<CachedSegment>::iterator> places_;
};

}  // namespace terraport
