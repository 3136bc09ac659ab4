#include "BaseBlocks.h"

#include <algorithm>
#include <cstring>
#include <unordered_set>

namespace terraport {

Status BaseBlocks::begin(const SceneFiles& files, std::uint32_t blockFaces) {
  *this = BaseBlocks();
  blockFaces_ = std::max<std::uint32_t>(blockFaces, 1);
  segmentCount_ = std::max<std::uint32_t>(files.manifest.segmentCount, 1);
  Status status = counters_.begin(files.cover);
  drawn_.assign(counters_.faceCount(), 0);
  const std::size_t blocks = (drawn_.size() + blockFaces_ - 1) / blockFaces_;
  stale_.assign(blocks, 0);
  prepared_.assign(blocks, 0);
  return status;
}

void BaseBlocks::prepare(const SegmentList& payloads, std::uint64_t revision) {
  if (revision == targetRevision_) {
    return;
  }
  targetRevision_ = revision;
  preparedRevision_ = 0;
  std::unordered_set<std::uint32_t> target;
  toRemove_.clear();
  toAdd_.clear();
  for (const std::uint32_t payload : payloads) {
    const std::uint32_t segment = payload % segmentCount_;
    // A plan has each segment at one level; of one that names both the face is hidden once.
    if (target.insert(segment).second && !counters_.isShown(segment)) {
      toAdd_.push_back(segment);
    }
  }
  for (const std::uint32_t segment : counters_.shown()) {
    if (target.count(segment) == 0) {
      toRemove_.push_back(segment);
    }
  }
}

bool BaseBlocks::step(SceneRenderer& renderer) {
  if (!toRemove_.empty() || !toAdd_.empty()) {
    changed_.clear();
    if (!toRemove_.empty()) {
      counters_.remove(toRemove_.back(), changed_);
      toRemove_.pop_back();
    } else {
      counters_.add(toAdd_.back(), changed_);
      toAdd_.pop_back();
    }
    for (const std::uint32_t face : changed_) {
      stale_[face / blockFaces_] = 1;
      firstStale_ = std::min<std::size_t>(firstStale_, face / blockFaces_);
    }
    return true;
  }
  if (targetRevision_ == preparedRevision_) {
    return false;
  }
  for (; firstStale_ < stale_.size(); ++firstStale_) {
    if (stale_[firstStale_] == 0) {
      continue;
    }
    stale_[firstStale_] = 0;
    // One that came back to what is drawn will not change, whatever the renderer has ready for it.
    if (!isAsDrawn(firstStale_)) {
      prepared_[firstStale_] = 1;
      renderer.prepareBase(rangeOf(firstStale_), {counters_.hidden().data(), counters_.faceCount()});
      return true;
    }
  }
  preparedRevision_ = targetRevision_;
  return true;
}

void BaseBlocks::flip(SceneSwap& swap) {
  for (std::size_t block = 0; block < prepared_.size(); ++block) {
    if (prepared_[block] != 0 && !isAsDrawn(block)) {
      const FaceRange range = rangeOf(block);
      std::memcpy(drawn_.data() + range.first, counters_.hidden().data() + range.first, range.count);
      swap.baseBlocks.push_back(range);
    }
    prepared_[block] = 0;
  }
  drawnCount_ = counters_.hiddenCount();
  drawnHash_ = counters_.hiddenHash();
  targetRevision_ = preparedRevision_ = 0;
  swap.baseHidden = {drawn_.data(), static_cast<std::uint32_t>(drawn_.size())};
}

FaceRange BaseBlocks::rangeOf(std::size_t block) const {
  const std::size_t first = block * blockFaces_;
  return {
      static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(std::min<std::size_t>(blockFaces_, drawn_.size() - first))};
}

bool BaseBlocks::isAsDrawn(std::size_t block) const {
  const FaceRange range = rangeOf(block);
  return std::memcmp(drawn_.data() + range.first, counters_.hidden().data() + range.first, range.count) == 0;
}

}  // namespace terraport
