// GLB's outer form: header, JSON chunk, BIN chunk (glTF 2.0 specification, section 4.4).
#pragma once

#include <cstddef>
#include <string_view>

#include "Terraport/Status.h"
#include "Terraport/Types.h"

namespace terraport {

/// The two chunks of a GLB: views of the payload.
struct GlbChunks {
  /// Not parsed; with the spaces that fill it up.
  std::string_view json;
  ByteSpan binary;
  /// Where the contents of each start in the payload, bytes.
  std::size_t jsonOffset = 0;
  std::size_t binaryOffset = 0;
};

/// Find a GLB's two chunks; safe on hostile bytes. The failure has the offset: wrong magic, version or length, a chunk of
/// another type or beyond the end, a JSON chunk of more than 1 MiB.
Status splitGlb(ByteSpan payload, GlbChunks& chunks);

}  // namespace terraport
