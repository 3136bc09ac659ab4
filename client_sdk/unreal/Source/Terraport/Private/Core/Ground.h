// The ground that is shown, for rays, feet and pointers: exact, without an engine's collision.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <vector>

#include "Core/Messages.h"
#include "Core/Segment.h"

namespace terraport {

/// A point of the ground along a ray.
struct GroundPoint {
  /// Multiples of the direction from the origin.
  double at = 0.0;
  Vec3 position;
  /// Unit, outwards.
  Vec3 normal;
  /// Segment id, -1 for the base.
  std::int64_t segment = -1;
};

/// A mesh that rays are cast against. Boxes over 64 consecutive faces keep a ray to few of them: builds write faces in an order
/// that is compact.
class GroundMesh {
 public:
  explicit GroundMesh(const SegmentMesh& mesh);

  std::size_t faceCount() const { return faceCount_; }

  /// Take the nearest point of a ray at 0 <= at <= nearest.at into `nearest`; whether there was one. Both sides of a face
  /// count. Faces whose bit is set in `hidden` are not there; null hides none.
  bool cast(const Vec3& origin, const Vec3& direction, const Bytes* hidden, GroundPoint& nearest) const;

  /// Add the corners of each face whose box meets a cube, nine numbers a face; false as soon as there would be more than so
  /// many numbers in all.
  bool gather(
      const Vec3& centre, double halfM, const Bytes* hidden, std::size_t mostNumbers, std::vector<float>& corners) const;

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
  std::size_t faceCount_ = 0;
  std::vector<Bounds> boxes_;
  Bounds whole_;
};

/// Made once of a mesh, on any thread, and never changed.
using SharedGround = std::shared_ptr<const GroundMesh>;

/// What is shown: segments, and the faces of the base that are not hidden. Changes with a swap alone. One thread.
class ShownGround {
 public:
  struct Piece {
    std::uint32_t segment = 0;
    SharedGround mesh;
  };

  void set(SharedGround base, Bytes hidden, std::map<Key, Piece> pieces);

  /// The nearest point of a ray at 0 <= at <= mostAt.
  bool cast(const Vec3& origin, const Vec3& direction, double mostAt, GroundPoint& point) const;

  /// The ground on the vertical through a position: the highest not above it, else the lowest above it.
  bool groundAt(const Vec3& position, GroundPoint& point) const;

  /// Corners, three numbers each, of all faces that meet a cube about `centre`, at most `mostFaces`: where there are more the
  /// cube is halved. Returns half of its side, 0 where it would be too small.
  double gather(const Vec3& centre, double halfM, std::size_t mostFaces, std::vector<float>& corners) const;

  /// Rises with each change.
  std::uint64_t changes() const { return changes_; }

 private:
  SharedGround base_;
  Bytes hidden_;
  std::map<Key, Piece> pieces_;
  std::uint64_t changes_ = 0;
};

}  // namespace terraport
