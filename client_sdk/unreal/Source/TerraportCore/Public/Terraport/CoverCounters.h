#pragma once

#include <cstdint>
#include <unordered_set>
#include <vector>

#include "Terraport/Api.h"
#include "Terraport/SceneFiles.h"
#include "Terraport/Status.h"

namespace terraport {

/// Which faces of the base mesh the shown segments hide.
///
/// The rule (docs/topics/hand-off.md): a base face is hidden if and only if its list is not empty and every segment in it is
/// shown. Each face has one counter, the number of segments over it that are *not* shown, so a landing costs only the faces
/// under the segments that change. No distance, no geometry: the outcome depends on the set alone.
class TERRAPORTCORE_API CoverCounters {
 public:
  /// Begin with nothing shown. O(faces + entries), once for a version. A failure where the arrays are no cover; the counters
  /// are then of a base without faces.
  Status begin(const Cover& cover);

  std::uint32_t faceCount() const { return static_cast<std::uint32_t>(hidden_.size()); }
  /// One byte per face, 1 where it must not be drawn.
  const std::vector<std::uint8_t>& hidden() const { return hidden_; }
  std::uint32_t hiddenCount() const { return hiddenCount_; }
  /// Hash of the set of hidden faces, whatever the order in which they came to be hidden.
  std::uint32_t hiddenHash() const { return hiddenHash_; }
  bool isShown(std::uint32_t segment) const { return shown_.count(segment) != 0; }
  const std::unordered_set<std::uint32_t>& shown() const { return shown_; }

  /// Whether some but not all segments over a drawn face are shown: only there can base and detail overlap.
  bool isRim(std::uint32_t face) const { return missing_[face] > 0 && missing_[face] < total_[face]; }

  /// Count one more segment as shown. Appends the faces that are hidden now and were not; a repeat changes nothing.
  void add(std::uint32_t segment, std::vector<std::uint32_t>& changed);
  /// Count a segment as no longer shown. Appends the faces that are to be drawn now and were not.
  void remove(std::uint32_t segment, std::vector<std::uint32_t>& changed);

 private:
  void flip(std::uint32_t face, std::vector<std::uint32_t>& changed);

  std::vector<std::uint8_t> hidden_;
  std::vector<std::uint32_t> missing_;
  std::vector<std::uint32_t> total_;
  /// The faces under segment s are faces_[starts_[s] .. starts_[s + 1]], ascending.
  std::vector<std::uint32_t> starts_;
  std::vector<std::uint32_t> faces_;
  std::unordered_set<std::uint32_t> shown_;
  std::uint32_t hiddenCount_ = 0;
  std::uint32_t hiddenHash_ = 0;
};

/// A well-mixed number for an id: the finaliser of MurmurHash3 (A. Appleby, public domain) over id + 1, as in every terraport
/// client.
TERRAPORTCORE_API std::uint32_t mix32(std::uint32_t id);

}  // namespace terraport
