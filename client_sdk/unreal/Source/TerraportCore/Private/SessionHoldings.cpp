#include "SessionHoldings.h"

#include <algorithm>

namespace terraport {

std::optional<SegmentFacts> Holdings::factsOf(std::uint32_t segment) const {
  if (const CachedSegment* const entry = cache_.peek(segment)) return entry->facts;
  const auto gone = gone_.find(segment);
  if (gone == gone_.end()) return std::nullopt;
  return gone->second;
}

void Holdings::put(CachedSegment entry) {
  gone_.erase(entry.facts.segment);
  cache_.put(std::move(entry));
}

std::vector<std::uint32_t> Holdings::trim() {
  std::vector<std::uint32_t> segments;
  for (const SegmentFacts& facts : cache_.trim()) {
    gone_[facts.segment] = facts;
    segments.push_back(facts.segment);
  }
  return segments;
}

void Holdings::forget(std::uint32_t segment) {
  cache_.discard(segment);
  gone_.erase(segment);
}

std::vector<ClientMessage> Holdings::evictions(const std::set<std::uint32_t>& spared) {
  std::vector<ClientMessage> messages;
  EvictMessage evict;
  for (auto gone = gone_.begin(); gone != gone_.end();) {
    if (spared.count(gone->first) != 0) {
      ++gone;
      continue;
    }
    evict.segments.push_back(gone->first);
    gone = gone_.erase(gone);
    if (evict.segments.size() == limits::kMaxHeldSegments) {
      messages.emplace_back(std::move(evict));
      evict = EvictMessage{};
    }
  }
  if (!evict.segments.empty()) messages.emplace_back(std::move(evict));
  return messages;
}

std::vector<HeldRow> Holdings::offer() {
  gone_.clear();
  std::vector<HeldRow> rows;
  rows.reserve(cache_.size());
  for (const CachedSegment& entry : cache_.entries()) rows.push_back({entry.facts.segment, entry.facts.xxh3});
  std::reverse(rows.begin(), rows.end());
  return rows;
}

}  // namespace terraport
