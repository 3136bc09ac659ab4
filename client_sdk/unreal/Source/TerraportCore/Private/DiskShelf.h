// A disk cache on a thread of its own: reads what was kept once, then writes what came.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "DiskCache.h"

namespace terraport {

/// What waits to be written is bounded; more is not kept. Destroying it ends the file in hand and drops what waits.
class DiskShelf {
 public:
  /// Begin to read, `mostBytes` at most. `cache` is this shelf's alone from now on.
  DiskShelf(DiskCache cache, std::uint64_t mostBytes);
  ~DiskShelf();
  DiskShelf(const DiskShelf&) = delete;
  DiskShelf& operator=(const DiskShelf&) = delete;

  /// Take what was read, once; nothing while it is being read.
  std::optional<std::vector<CachedSegment>> takeRestored();

  /// Keep a payload; soon, not now.
  void put(CachedSegment entry);

  /// Note that a segment was used.
  void use(const SegmentFacts& facts);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace terraport
