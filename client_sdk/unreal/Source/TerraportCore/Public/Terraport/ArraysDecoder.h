#pragma once

#include <cstdint>
#include <memory>

#include "Terraport/Api.h"
#include "Terraport/SegmentMesh.h"
#include "Terraport/Status.h"
#include "Terraport/Types.h"

namespace terraport {

class FlatFile;

/// Decodes arrays payloads (scene format, section 10). Safe on hostile bytes: nothing is reserved that the payload does not have.
///
/// Holds memory that is used again: one for each thread that decodes. Decoding allocates nothing once the mesh has seen a payload
/// of that size.
class TERRAPORTCORE_API ArraysDecoder {
 public:
  ArraysDecoder();
  ~ArraysDecoder();
  ArraysDecoder(const ArraysDecoder&) = delete;
  ArraysDecoder& operator=(const ArraysDecoder&) = delete;

  /// Decode a whole payload of the segment of that id. After a failure the mesh is empty. `payload` is only read, and not needed
  /// afterwards but for the image.
  Status decode(ByteSpan payload, std::int64_t segment, SegmentMesh& mesh);

 private:
  Status read(ByteSpan payload, SegmentMesh& mesh);

  std::unique_ptr<FlatFile> file_;
};

}  // namespace terraport
