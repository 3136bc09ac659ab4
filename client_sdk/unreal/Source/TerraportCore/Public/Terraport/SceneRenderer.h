// What a stage asks of an engine: the one interface between the two.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "Terraport/Api.h"
#include "Terraport/SceneFiles.h"
#include "Terraport/SegmentMesh.h"

namespace terraport {

/// Some consecutive faces of the base mesh.
struct FaceRange {
  std::uint32_t first = 0;
  std::uint32_t count = 0;
};

/// Which faces of the base mesh are not drawn. A view of the stage's memory: valid during the call.
struct HiddenFaces {
  /// One byte per face, 1 where it is not to be drawn.
  const std::uint8_t* faces = nullptr;
  std::uint32_t faceCount = 0;
};

/// What changes in one frame.
struct SceneSwap {
  std::int64_t landing = kNoLanding;
  /// The declared inner part of the landing alone.
  bool degraded = false;
  /// Segments that become visible, and that cease to be; ascending.
  std::vector<std::uint32_t> shown;
  std::vector<std::uint32_t> hidden;
  /// Blocks of the base whose hidden faces differ from those that were drawn: each was prepared.
  std::vector<FaceRange> baseBlocks;
  /// The whole base, as it is drawn from now on.
  HiddenFaces baseHidden;
};

enum class UploadState : std::uint8_t {
  Done,
  /// Call again in the next frame: the work is done in slices, or waits for something.
  More,
  /// It cannot be drawn (no memory): it counts as missing, and its base faces stay.
  Failed,
};

/// Draws what a stage orders. All calls come from the thread that calls SceneStage::update.
class TERRAPORTCORE_API SceneRenderer {
 public:
  virtual ~SceneRenderer() = default;

  /// Make a segment drawable, but hidden. `payload` is where `mesh.image` lies. Mesh and payload are the caller's, and stay
  /// valid until Done or Failed was returned, or `free` called.
  virtual UploadState upload(std::uint32_t segment, const SegmentMesh& mesh, ByteSpan payload) = 0;

  /// Whether an uploaded segment can be drawn at once without any further preparation (its image is decoded, its shader
  /// compiled). Asked once a frame until it is true.
  virtual bool isDrawable(std::uint32_t segment) {
    (void)segment;
    return true;
  }

  /// Give back everything of a segment; hidden, or of an earlier version and shown.
  virtual void free(std::uint32_t segment) = 0;

  /// GPU bytes that a mesh will take; bounds what is kept for nobody.
  virtual std::size_t gpuBytesOf(const SegmentMesh& mesh) const;

  /// There is a base mesh, of a first or another version: what was there of an earlier one goes, shown segments included (they
  /// are not freed one by one). All faces are to be drawn. `files` stay valid until the next call, or the stage's end.
  virtual void beginBase(const SceneFiles& files) = 0;

  /// One block of the base, prepared and not drawn yet: at the swap that names the block its hidden faces are to be `next`.
  /// Called again for the same block where the coming set changed meanwhile. What is drawn does not change.
  virtual void prepareBase(const FaceRange& block, const HiddenFaces& next) = 0;

  /// Whether the base of the last `beginBase` is drawn: nothing is swapped before. Asked once a frame until it is true.
  virtual bool isBaseReady() { return true; }

  /// Change what is drawn, at once: flags alone, everything was uploaded and prepared.
  virtual void swap(const SceneSwap& change) = 0;
};

}  // namespace terraport
