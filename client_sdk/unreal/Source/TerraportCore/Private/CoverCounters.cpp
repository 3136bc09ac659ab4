#include "Terraport/CoverCounters.h"

#include <algorithm>
#include <string>

#include "Terraport/CoverFile.h"

namespace terraport {
namespace {

/// More rows than an index of 1 GiB, the most that there may be, has: nothing is allocated by an id beyond it.
constexpr std::uint32_t kMaxSegments = std::uint32_t{1} << 25;

}  // namespace

Status CoverCounters::begin(const Cover& cover) {
  *this = CoverCounters();
  TERRAPORT_RETURN_IF_ERROR(checkCover(cover, kMaxSegments));
  const std::uint32_t faceCount = cover.faceCount();
  hidden_.assign(faceCount, 0);
  total_.resize(faceCount);
  std::uint32_t segmentEnd = 0;
  for (const std::uint32_t segment : cover.segments) {
    segmentEnd = std::max(segmentEnd, segment + 1);
  }
  starts_.assign(std::size_t{segmentEnd} + 1, 0);
  for (const std::uint32_t segment : cover.segments) {
    ++starts_[segment + 1];
  }
  for (std::uint32_t segment = 0; segment < segmentEnd; ++segment) {
    starts_[segment + 1] += starts_[segment];
  }
  std::vector<std::uint32_t> next(starts_.begin(), starts_.end());
  faces_.resize(cover.segments.size());
  for (std::uint32_t face = 0; face < faceCount; ++face) {
    const std::uint32_t end = cover.offsets[face + 1];
    total_[face] = end - cover.offsets[face];
    for (std::uint32_t entry = cover.offsets[face]; entry < end; ++entry) {
      faces_[next[cover.segments[entry]]++] = face;
    }
  }
  missing_ = total_;
  return {};
}

void CoverCounters::add(std::uint32_t segment, std::vector<std::uint32_t>& changed) {
  // One over no face is remembered, but it hides nothing.
  if (!shown_.insert(segment).second || std::size_t{segment} + 1 >= starts_.size()) {
    return;
  }
  for (std::uint32_t entry = starts_[segment]; entry < starts_[segment + 1]; ++entry) {
    if (--missing_[faces_[entry]] == 0) {
      flip(faces_[entry], changed);
    }
  }
}

void CoverCounters::remove(std::uint32_t segment, std::vector<std::uint32_t>& changed) {
  if (shown_.erase(segment) == 0 || std::size_t{segment} + 1 >= starts_.size()) {
    return;
  }
  for (std::uint32_t entry = starts_[segment]; entry < starts_[segment + 1]; ++entry) {
    if (missing_[faces_[entry]]++ == 0) {
      flip(faces_[entry], changed);
    }
  }
}

void CoverCounters::flip(std::uint32_t face, std::vector<std::uint32_t>& changed) {
  hidden_[face] ^= 1;
  hiddenCount_ += hidden_[face] != 0 ? 1U : ~0U;
  hiddenHash_ ^= mix32(face);
  changed.push_back(face);
}

std::uint32_t mix32(std::uint32_t id) {
  std::uint32_t h = (id + 1) * 0x9e3779b1U;
  h = (h ^ (h >> 16)) * 0x85ebca6bU;
  h = (h ^ (h >> 13)) * 0xc2b2ae35U;
  return h ^ (h >> 16);
}

}  // namespace terraport
