#pragma once

#include <cstdint>

#include "Terraport/Api.h"
#include "Terraport/Json.h"
#include "Terraport/SegmentBuffer.h"
#include "Terraport/SegmentMesh.h"
#include "Terraport/Status.h"
#include "Terraport/Types.h"

namespace terraport {

/// Decodes the base mesh (scene format, section 9); arrays stay quantised. Safe on hostile bytes: n bytes never
/// make more than about 64 n, and every number is looked at before it is used.
class TERRAPORTCORE_API GlbDecoder {
 public:
  /// Decode a whole GLB. After a failure the mesh is empty. `payload` is only read, and not needed afterwards but for the
  /// image.
  Status decode(ByteSpan payload, SegmentMesh& mesh);

 private:
  JsonDocument document_;
  SegmentBuffer<std::uint8_t> rows_;

  friend class GlbReading;
};

}  // namespace terraport
