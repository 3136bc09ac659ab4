#pragma once

#include <cstdint>

#include "Terraport/Api.h"
#include "Terraport/Json.h"
#include "Terraport/SegmentBuffer.h"
#include "Terraport/SegmentMesh.h"
#include "Terraport/Status.h"
#include "Terraport/Types.h"

namespace terraport {

/// Decodes GLB payloads and the base mesh (scene format, section 9); arrays stay quantised. Safe on hostile bytes: a payload of
/// n bytes never makes more than about 64 n, and every number is looked at before it is used.
///
/// Holds memory that is used again: one for each thread that decodes. Decoding allocates nothing once it and the mesh have seen
/// a payload of that size.
class TERRAPORTCORE_API GlbDecoder {
 public:
  /// Decode a whole payload. `segment` is its id; -1 for the base mesh, whose image may be larger. After a failure the mesh is
  /// empty. `payload` is only read, and not needed afterwards but for the image.
  Status decode(ByteSpan payload, std::int64_t segment, SegmentMesh& mesh);

 private:
  JsonDocument document_;
  SegmentBuffer<std::uint8_t> rows_;

  friend class GlbReading;
};

}  // namespace terraport
