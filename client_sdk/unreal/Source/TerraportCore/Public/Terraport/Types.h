// The values that pass between the parts of the client. Lengths are metres of the scene frame (right-handed, x east, y up,
// z south, about the scene's origin); segment ids are rows of the scene's index.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

namespace terraport {

/// Bytes that belong to somebody else.
struct ByteSpan {
  const std::uint8_t* data = nullptr;
  std::size_t size = 0;
};

/// The bytes of a payload.
inline ByteSpan viewOf(const std::vector<std::uint8_t>& bytes) { return {bytes.data(), bytes.size()}; }

/// A payload as it came, kept alive by whoever holds it: the cache may let it go while a decoder still reads it.
using SharedPayload = std::shared_ptr<const std::vector<std::uint8_t>>;

/// Metres of the scene frame, or a direction in it.
struct Vec3 {
  double x = 0.0;
  double y = 0.0;
  double z = 0.0;
};

/// An axis-aligned box, metres of the scene frame.
struct Box {
  float minX = 0.0F;
  float minY = 0.0F;
  float minZ = 0.0F;
  float maxX = 0.0F;
  float maxY = 0.0F;
  float maxZ = 0.0F;
};

/// What the index says of one segment.
struct SegmentFacts {
  std::uint32_t segment = 0;
  /// Payload bytes.
  std::uint32_t length = 0;
  /// XXH3-64 of the payload.
  std::uint64_t xxh3 = 0;
  std::uint32_t faces = 0;
  std::uint32_t vertices = 0;
  Box bounds;
};

}  // namespace terraport
