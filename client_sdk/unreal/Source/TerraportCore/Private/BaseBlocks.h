// The base's hidden faces: those drawn, and those of the coming set, made ready in slices.
#pragma once

#include <cstdint>
#include <vector>

#include "LandingRecord.h"
#include "Terraport/CoverCounters.h"
#include "Terraport/SceneFiles.h"
#include "Terraport/SceneRenderer.h"

namespace terraport {

/// The base is cut into blocks of consecutive faces. A block whose faces change is prepared at the renderer, and changes at the
/// swap; what is drawn does not change before.
class BaseBlocks {
 public:
  /// Begin with every face drawn. `blockFaces` is at least 1.
  Status begin(const SceneFiles& files, std::uint32_t blockFaces);

  /// Make the next swap's faces those of the segments of these payloads, at whichever level; `step` does the work.
  void prepare(const SegmentList& payloads, std::uint64_t revision);
  /// One slice of work: the faces under one segment, or one block. False where there was nothing to do.
  bool step(SceneRenderer& renderer);
  /// Revision that is prepared, or 0.
  std::uint64_t preparedRevision() const { return preparedRevision_; }
  /// Take what was prepared for what is drawn, and say which blocks changed.
  void flip(SceneSwap& swap);

  /// Number and hash (CoverCounters) of the base faces that are hidden in what is drawn.
  std::uint32_t hiddenCount() const { return drawnCount_; }
  std::uint32_t hiddenHash() const { return drawnHash_; }

 private:
  FaceRange rangeOf(std::size_t block) const;
  bool isAsDrawn(std::size_t block) const;

  CoverCounters counters_;
  /// Ids from here on are those of the coarser level; a cover names segments.
  std::uint32_t segmentCount_ = 1;
  std::uint32_t blockFaces_ = 1;
  std::vector<std::uint8_t> drawn_;
  std::uint32_t drawnCount_ = 0;
  std::uint32_t drawnHash_ = 0;
  /// Blocks whose faces changed since they were prepared; and those that were prepared since the last flip.
  std::vector<std::uint8_t> stale_;
  std::vector<std::uint8_t> prepared_;
  std::size_t firstStale_ = 0;
  SegmentList toAdd_;
  SegmentList toRemove_;
  std::vector<std::uint32_t> changed_;
  std::uint64_t targetRevision_ = 0;
  std::uint64_t preparedRevision_ = 0;
};

}  // namespace terraport
