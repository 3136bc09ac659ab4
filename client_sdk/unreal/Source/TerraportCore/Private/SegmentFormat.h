// Segments in segment format 2 (spec/segment-format.md).
#pragma once

#include <zlib.h>

#include <cstdint>
#include <vector>

#include "Terraport/SceneFiles.h"
#include "Terraport/SegmentBuffer.h"
#include "Terraport/SegmentMesh.h"
#include "Terraport/Status.h"
#include "Terraport/Types.h"

namespace terraport {

/// Decodes segments; what their vertices have stays whole numbers. Safe on any bytes: planes take at most 2^28 bytes, a mesh at
/// most about six times its planes, and every length is checked before memory is asked for.
///
/// Holds memory that is used again: one for each thread that decodes. Decoding allocates nothing once it and the mesh have seen
/// a segment of that size.
class SegmentDecoder {
 public:
  SegmentDecoder() = default;
  ~SegmentDecoder();
  SegmentDecoder(const SegmentDecoder&) = delete;
  SegmentDecoder& operator=(const SegmentDecoder&) = delete;

  /// Decode a whole payload. `attributes` are the scene's, in the manifest's order; `segment` is the payload's id. After a
  /// failure the mesh is empty. `payload` is only read, and not needed afterwards but for the image.
  Status decode(ByteSpan payload, const std::vector<AttributeInfo>& attributes, std::int64_t segment, SegmentMesh& mesh);

 private:
  Status inflateStream(ByteSpan packed);

  z_stream inflater_ = {};
  bool isReady_ = false;
  SegmentBuffer<std::uint8_t> stream_;
  /// Vertices of the corners that are not new.
  SegmentBuffer<std::uint32_t> oldCorners_;

  friend class SegmentReading;
};

}  // namespace terraport
