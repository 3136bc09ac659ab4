// The ground that is shown, for feet and pointers.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "Terraport/Api.h"
#include "Terraport/GroundPoint.h"
#include "Terraport/SceneRenderer.h"
#include "Terraport/Types.h"

namespace terraport {

class GroundMesh;

/// A mesh made ready for rays; may be made on any thread, and is never changed after that.
using SharedGround = std::shared_ptr<const GroundMesh>;

/// Copy a mesh for rays: 12 bytes a vertex and 6 a face (12 above 65,536 vertices). O(faces).
TERRAPORTCORE_API SharedGround groundOf(const SegmentMesh& mesh);

/// Knows the ground that a renderer shows: stands between a SceneStage and its renderer. Detail where it is shown, the base
/// elsewhere, no hidden face of it; it changes with the swap and with nothing else. One thread, that of the stage.
class TERRAPORTCORE_API ShownGround final : public SceneRenderer {
 public:
  /// Gives what was made ready of a mesh while it was decoded; null where there is none.
  using Made = std::function<SharedGround(const SegmentMesh& mesh)>;

  /// Know what `renderer` shows from now on; it outlives this. Without `made` a segment is made ready in its upload.
  explicit ShownGround(SceneRenderer& renderer, Made made = nullptr);
  ~ShownGround() override;
  ShownGround(const ShownGround&) = delete;
  ShownGround& operator=(const ShownGround&) = delete;

  /// The base of the next `beginBase`, made ready elsewhere: for a large one it takes longer than a frame.
  void setBase(SharedGround base);

  /// The first point of a ray of what is shown. `direction` is of any length but 0, `mostAt` counts in it.
  bool cast(const Vec3& origin, const Vec3& direction, double mostAt, GroundPoint& point) const;

  /// Ground on the vertical through a point: the highest not above it, else the lowest above it.
  bool groundAt(const Vec3& position, GroundPoint& point) const;

  /// How often what is shown has changed.
  std::uint64_t changes() const;

  /// Faces of what is shown around a place, to be made solid: those whose box meets a cube of half the side `halfM`. Where
  /// these are more than `mostFaces` the cube is halved, four times at most. `corners` then has three corners a face,
  /// counter-clockwise from outside, metres of the scene frame. Returns half the side of the cube of which all faces are there;
  /// 0 where that was none.
  double gather(const Vec3& centre, double halfM, std::size_t mostFaces, std::vector<float>& corners) const;

  UploadState upload(std::uint32_t segment, const SegmentMesh& mesh, ByteSpan payload) override;
  bool isDrawable(std::uint32_t segment) override;
  void free(std::uint32_t segment) override;
  std::size_t gpuBytesOf(const SegmentMesh& mesh) const override;
  void beginBase(const SceneFiles& files) override;
  void prepareBase(const FaceRange& block, const HiddenFaces& next) override;
  bool isBaseReady() override;
  void swap(const SceneSwap& change) override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace terraport
