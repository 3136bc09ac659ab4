#include "SessionHoldings.h"

#include <algorithm>

namespace terraport {

std::optional<SegmentFacts> Holdings::factsOf(std::uint32_t segment) const {
  if (const CachedSegment* const entry = cache_.peek(segment)) return entry->facts;
  const auto eviction = unreported_.find(segment);
  if (eviction == unreported_.end()) return std::nullopt;
  return eviction->second;
}

void Holdings::put(CachedSegment entry) {
  unreported_.erase(entry.facts.segment);
  cache_.put(std::move(entry));
}

std::vector<std::uint32_t> Holdings::trim() {
  std::vector<std::uint32_t> segments;
  for (const SegmentFacts& facts : cache_.trim()) {
    unreported_[facts.segment] = facts;
    segments.push_back(facts.segment);
  }
  return segments;
}

void Holdings::forget(std::uint32_t segment) {
  cache_.discard(segment);
  unreported_.erase(segment);
}

std::vector<ClientMessage> Holdings::evictions(const std::set<std::uint32_t>& spared) {
  std::vector<ClientMessage> messages;
  EvictMessage evict;
  for (auto eviction = unreported_.begin(); eviction != unreported_.end();) {
    if (spared.count(eviction->first) != 0) {
      ++eviction;
      continue;
    }
    evict.segments.push_back(eviction->first);
    eviction = unreported_.erase(eviction);
    if (evict.segments.size() == limits::kMaxHeldSegments) {
      messages.emplace_back(std::move(evict));
      evict = EvictMessage{};
    }
  }
  if (!evict.segments.empty()) messages.emplace_back(std::move(evict));
  return messages;
}

std::vector<HeldRow> Holdings::offer() {
  unreported_.clear();
  std::vector<HeldRow> rows;
  rows.reserve(cache_.size());
  for (const CachedSegment& entry : cache_.entries()) rows.push_back({entry.facts.segment, entry.facts.xxh3});
  std::reverse(rows.begin(), rows.end());
  return rows;
}

}  // namespace terraport
