#include "Terraport/CoverFile.h"

#include <algorithm>
#include <cstring>
#include <string>

#include "LittleEndian.h"
#include "Terraport/Xxh3.h"

namespace terraport {
namespace {

constexpr std::size_t kHeaderBytes = 32;
constexpr std::uint16_t kMajor = 1;
/// Base faces, and entries of all rows together: a few bytes can stand for any number of them.
constexpr std::uint32_t kMaxRows = std::uint32_t{1} << 24;
/// Segments over one base face: bounds what one step costs.
constexpr std::size_t kMaxRowSegments = 4096;
/// How many segments a step can name by half a byte; fifteen itself says that a number follows.
constexpr std::size_t kRecent = 15;

/// A segment that goes in or out of the row, and how many faces then have the row.
struct Step {
  std::uint32_t segment = 0;
  std::uint64_t run = 0;
};

/// Steps, one after the other.
class StepReader {
 public:
  StepReader(ByteSpan file, std::size_t start) : file_(file), at_(start) {}

  std::size_t at() const { return at_; }

  /// False where the bytes end, or a number is beyond 32 bits.
  bool next(Step& step) {
    if (at_ == file_.size) {
      return false;
    }
    const std::uint8_t byte = file_.data[at_++];
    const std::size_t rank = byte & 15U;
    if (rank < kRecent) {
      step.segment = recent_[rank];
    } else {
      std::uint32_t ahead = 0;
      if (!readNumber(ahead)) {
        return false;
      }
      // Even numbers lead ahead of the last segment, odd ones back; in 32 bits, around their end.
      step.segment = recent_[0] + ((ahead >> 1) ^ (0U - (ahead & 1U)));
    }
    std::copy_backward(recent_, recent_ + std::min(rank, kRecent - 1), recent_ + std::min(rank, kRecent - 1) + 1);
    recent_[0] = step.segment;
    step.run = byte >> 4;
    if (step.run < 15) {
      return true;
    }
    std::uint32_t more = 0;
    const bool isWhole = readNumber(more);
    step.run += more;
    return isWhole;
  }

 private:
  /// Seven bits a byte, lowest first; the top bit says that more follow.
  bool readNumber(std::uint32_t& number) {
    std::uint64_t value = 0;
    for (unsigned shift = 0; shift < 35 && at_ < file_.size; shift += 7) {
      const std::uint8_t byte = file_.data[at_++];
      value |= std::uint64_t{byte & 0x7fU} << shift;
      if (byte < 0x80) {
        number = static_cast<std::uint32_t>(value);
        return value >> 32 == 0;
      }
    }
    return false;
  }

  ByteSpan file_;
  std::size_t at_;
  /// The segments that steps named last, the last one first.
  std::uint32_t recent_[kRecent] = {};
};

/// The header, and the checksum over all that follows it.
Status checkHeader(ByteSpan file, std::uint32_t baseFaces) {
  if (file.size < kHeaderBytes) {
    return Status::damaged(std::to_string(file.size) + " bytes, expected " + std::to_string(kHeaderBytes) + " or more", 0);
  }
  if (std::memcmp(file.data, "TPCOVER1", 8) != 0) {
    return Status::damaged("another magic, expected TPCOVER1", 0);
  }
  if (readU16(file.data + 16) != kMajor) {
    return Status::damaged("format version " + std::to_string(readU16(file.data + 16)) + ", expected 1", 16);
  }
  if (xxh3Hash64({file.data + 16, file.size - 16}) != readU64(file.data + 8)) {
    return Status::damaged("the checksum is another than that of the bytes", 8);
  }
  const std::uint32_t start = readU32(file.data + 20);
  if (start < kHeaderBytes || start > file.size) {
    return Status::damaged("steps at " + std::to_string(start) + " of " + std::to_string(file.size) + " bytes", 20);
  }
  const std::uint32_t rows = readU32(file.data + 24);
  if (rows != baseFaces) {
    return Status::damaged("cover of " + std::to_string(rows) + " base faces, expected " + std::to_string(baseFaces), 24);
  }
  if (std::max(rows, readU32(file.data + 28)) > kMaxRows) {
    return Status::damaged("cover of " + std::to_string(rows) + " base faces and " + std::to_string(readU32(file.data + 28)) +
            " entries, expected at most " + std::to_string(kMaxRows),
        24);
  }
  return {};
}

/// Put a segment into an ascending row, or take it out.
void toggle(std::vector<std::uint32_t>& row, std::uint32_t segment) {
  const auto place = std::lower_bound(row.begin(), row.end(), segment);
  if (place != row.end() && *place == segment) {
    row.erase(place);
  } else {
    row.insert(place, segment);
  }
}

}  // namespace

Status decodeCover(ByteSpan file, std::uint32_t baseFaces, std::uint32_t segmentCount, Cover& cover) {
  cover.offsets.clear();
  cover.segments.clear();
  TERRAPORT_RETURN_IF_ERROR(checkHeader(file, baseFaces));
  // (1) What the rows take is known, and within the limits.
  const std::size_t entries = readU32(file.data + 28);
  cover.offsets.reserve(std::size_t{baseFaces} + 1);
  cover.offsets.push_back(0);
  cover.segments.reserve(entries);
  // (2) Step by step. Invariant: what has been given to faces is at most what the header counts, and rows ascend.
  StepReader steps(file, readU32(file.data + 20));
  std::vector<std::uint32_t> row;
  while (cover.offsets.size() <= baseFaces) {
    const auto at = static_cast<std::int64_t>(steps.at());
    Step step;
    if (!steps.next(step)) {
      return Status::damaged("the steps end early, or a number in them is beyond 32 bits", at);
    }
    if (step.segment >= segmentCount) {
      return Status::damaged(
          "segment " + std::to_string(step.segment) + " in the cover, expected below " + std::to_string(segmentCount), at);
    }
    toggle(row, step.segment);
    if (row.size() > kMaxRowSegments) {
      return Status::damaged("more than " + std::to_string(kMaxRowSegments) + " segments over a base face", at);
    }
    const std::size_t facesLeft = std::size_t{baseFaces} + 1 - cover.offsets.size();
    const std::size_t entriesLeft = entries - cover.segments.size();
    if (step.run > facesLeft || step.run * row.size() > entriesLeft) {
      return Status::damaged(std::to_string(step.run) + " base faces of " + std::to_string(row.size()) +
              " segments, expected " + std::to_string(facesLeft) + " faces and " + std::to_string(entriesLeft) +
              " entries at most",
          at);
    }
    for (std::uint64_t face = 0; face < step.run; ++face) {
      cover.segments.insert(cover.segments.end(), row.begin(), row.end());
      cover.offsets.push_back(static_cast<std::uint32_t>(cover.segments.size()));
    }
  }
  // (3) Nothing is left.
  if (steps.at() != file.size || cover.segments.size() != entries) {
    return Status::damaged("bytes or entries left over, expected none", static_cast<std::int64_t>(steps.at()));
  }
  return {};
}

Status checkCover(const Cover& cover, std::uint32_t segmentCount) {
  const std::vector<std::uint32_t>& offsets = cover.offsets;
  const std::vector<std::uint32_t>& segments = cover.segments;
  if (offsets.empty() || offsets.front() != 0 || offsets.back() != segments.size()) {
    return Status::damaged("cover offsets do not run from 0 to " + std::to_string(segments.size()));
  }
  // All of them before any row is read: until then an offset may point anywhere.
  for (std::size_t face = 0; face + 1 < offsets.size(); ++face) {
    if (offsets[face + 1] < offsets[face]) {
      return Status::damaged("cover offsets decrease at base face " + std::to_string(face) + ", expected ascending");
    }
  }
  for (std::size_t face = 0; face + 1 < offsets.size(); ++face) {
    for (std::size_t at = offsets[face]; at < offsets[face + 1]; ++at) {
      if (segments[at] >= segmentCount) {
        return Status::damaged(
            "segment " + std::to_string(segments[at]) + " in the cover, expected below " + std::to_string(segmentCount));
      }
      if (at > offsets[face] && segments[at] <= segments[at - 1]) {
        return Status::damaged(
            "segments over base face " + std::to_string(face) + " do not ascend, expected each once, ascending");
      }
    }
  }
  return {};
}

}  // namespace terraport
