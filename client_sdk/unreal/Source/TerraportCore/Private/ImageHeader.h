#pragma once

#include <cstdint>

#include "Terraport/SegmentMesh.h"
#include "Terraport/Status.h"
#include "Terraport/Types.h"

namespace terraport {

/// What an image file says of itself.
struct ImageHeader {
  ImageType type = ImageType::None;
  /// Pixels; not compared with any limit.
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  /// What a GPU keeps of a texel: 4 (ETC1S), 8 (UASTC) or 32 (whatever GPUs cannot read).
  std::uint32_t texelBits = 32;
};

/// Read an image file's header without decoding it; safe on hostile bytes. Nobody may hand an image library fifty bytes that
/// claim 65535 x 65535 pixels.
Status readImageHeader(ByteSpan file, ImageHeader& header);

/// As above, with the sides compared with the limits of a segment or a base (scene format, section 9).
Status readPayloadImage(ByteSpan file, bool isBase, ImageHeader& header);

}  // namespace terraport
