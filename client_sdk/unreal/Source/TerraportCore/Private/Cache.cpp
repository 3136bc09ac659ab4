#include "Cache.h"

namespace terraport {

const CachedSegment* SegmentCache::get(std::uint32_t segment) {
  const auto slot = index_.find(segment);
  if (slot == index_.end()) return nullptr;
  entries_.splice(entries_.end(), entries_, slot->second);
  return &*slot->second;
}

const CachedSegment* SegmentCache::peek(std::uint32_t segment) const {
  const auto slot = index_.find(segment);
  return slot == index_.end() ? nullptr : &*slot->second;
}

void SegmentCache::put(CachedSegment entry) {
  const std::uint32_t segment = entry.facts.segment;
  discard(segment);
  bytes_ += entry.payload->size();
  entries_.push_back(std::move(entry));
  index_[segment] = std::prev(entries_.end());
}

bool SegmentCache::discard(std::uint32_t segment) {
  const auto slot = index_.find(segment);
  if (slot == index_.end()) return false;
  bytes_ -= slot->second->payload->size();
  entries_.erase(slot->second);
  index_.erase(slot);
  return true;
}

std::vector<SegmentFacts> SegmentCache::trim() {
  std::vector<SegmentFacts> evicted;
  for (auto entry = entries_.begin(); entry != entries_.end() && bytes_ > maxBytes_;) {
    const SegmentFacts facts = entry->facts;
    ++entry;
    if (pinned_.count(facts.segment) != 0) continue;
    discard(facts.segment);
    evicted.push_back(facts);
  }
  return evicted;
}

}  // namespace terraport
