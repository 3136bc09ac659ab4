// What the client holds, and which evictions the server does not know yet. Pure.
#pragma once

#include "Cache.h"
#include "Messages.generated.h"

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <vector>

namespace terraport {

/// The cache, and the evictions that the server does not know yet: a segment that is not held any more must be named in an
/// `evict` before the next `land` or `aim` (wire protocol, 6.7), since the server counts on what it once sent.
class Holdings {
 public:
  explicit Holdings(std::uint64_t cacheBytes) : cache_(cacheBytes) {}

  std::uint64_t bytes() const { return cache_.bytes(); }
  std::size_t count() const { return cache_.size(); }
  bool has(std::uint32_t segment) const { return cache_.has(segment); }

  /// Make it the most recently used; whether it is held.
  bool recall(std::uint32_t segment) { return cache_.get(segment) != nullptr; }

  /// The entry, without changing its age; null where it is not held.
  const CachedSegment* peek(std::uint32_t segment) const { return cache_.peek(segment); }

  /// Facts of what is held, or was evicted and not named in an `evict` yet.
  std::optional<SegmentFacts> factsOf(std::uint32_t segment) const;

  void put(CachedSegment entry);

  /// Make exactly these the ones that must not be evicted.
  void pin(std::set<std::uint32_t> segments) { cache_.pin(std::move(segments)); }

  /// Evict down to the bound; returns the ids that went.
  std::vector<std::uint32_t> trim();

  /// Drop a segment that the server knows to be gone: dropped by it, or rejected.
  void forget(std::uint32_t segment);

  /// The `evict` messages for all evictions that the server does not know yet, once. `spared`: ids of a plan that is not ready,
  /// which must not be evicted now; they are named later.
  std::vector<ClientMessage> evictions(const std::set<std::uint32_t>& spared);

  /// Everything held, most recently used first; what is not in it counts as evicted, so no `evict` is owed any more.
  std::vector<HeldRow> offer();

 private:
  SegmentCache cache_;
  /// Evicted here, and not named in an `evict` yet. Facts too: a plan that crossed may still keep one of them.
  std::map<std::uint32_t, SegmentFacts> unreported_;
};

}  // namespace terraport
