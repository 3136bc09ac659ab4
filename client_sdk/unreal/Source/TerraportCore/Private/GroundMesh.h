#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "Terraport/GroundPoint.h"
#include "Terraport/SegmentMesh.h"

namespace terraport {

/// A mesh that rays are cast against. Boxes over 64 consecutive faces keep a ray to few of them: builds write faces in an order
/// that is compact.
class GroundMesh {
 public:
  explicit GroundMesh(const SegmentMesh& mesh);

  std::uint32_t faceCount() const { return faceCount_; }

  /// Take the nearest point of a ray at 0 <= at <= nearest.at into `nearest`; whether there was one. Both sides of a face
  /// count. Faces with 1 in `hidden` are not there; null hides none.
  bool cast(const Vec3& origin, const Vec3& direction, const std::uint8_t* hidden, GroundPoint& nearest) const;

  /// Add the corners of each face whose box meets a cube, nine numbers a face; false as soon as there would be more than so
  /// many numbers in all.
  bool gather(
      const Vec3& centre, double halfM, const std::uint8_t* hidden, std::size_t mostNumbers, std::vector<float>& corners) const;

 private:
  struct Bounds {
    float low[3];
    float high[3];
    void grow(const float* position);
    bool meetsCube(const Vec3& centre, double halfM) const;
    bool isEntered(const Vec3& origin, const Vec3& direction, double mostAt) const;
  };
  static Bounds nothing();

  bool meets(std::size_t face, const Vec3& origin, const Vec3& direction, GroundPoint& nearest) const;
  /// Position of a corner, by its place in the indices: three numbers.
  const float* positionOf(std::size_t at) const {
    const std::size_t vertex = shortIndices_.empty() ? longIndices_[at] : shortIndices_[at];
    return &positions_[3 * vertex];
  }
  Vec3 corner(std::size_t at) const;

  std::vector<float> positions_;
  /// One of the two, the short where they do: a segment's nearly always, and they are half of what a face takes.
  std::vector<std::uint16_t> shortIndices_;
  std::vector<std::uint32_t> longIndices_;
  std::uint32_t faceCount_ = 0;
  std::vector<Bounds> boxes_;
  Bounds whole_;
};

}  // namespace terraport
