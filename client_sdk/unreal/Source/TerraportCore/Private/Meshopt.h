// Decoders of EXT_meshopt_compression (Khronos specification, appendices A and B), as far as payloads use it: attributes with
// codec 0, triangles with codec 1, filters octahedral and exponential. Safe on hostile bytes: nothing beyond `packed` is read,
// nothing beyond the given counts is written.
#pragma once

#include <cstddef>
#include <cstdint>

#include "Terraport/Types.h"

namespace terraport {

/// First byte of the two kinds of stream.
constexpr std::uint8_t kMeshoptVertexCodec = 0xa0;
constexpr std::uint8_t kMeshoptIndexCodec = 0xe1;

/// Decode mode 0. `rows` takes count * stride bytes; stride is 4, 8, 12 or 16. False where the bytes are no such stream.
[[nodiscard]] bool meshoptDecodeVertices(ByteSpan packed, std::size_t count, std::size_t stride, std::uint8_t* rows);

/// Decode mode 1 into `count` numbers; count is a multiple of 3. Numbers are not compared with any number of vertices.
[[nodiscard]] bool meshoptDecodeTriangles(ByteSpan packed, std::size_t count, std::uint32_t* indices);

/// Undo the octahedral filter in place: rows of four bytes become unit vectors, 127 is 1, the fourth byte stays. A row that is
/// no vector becomes 0, 0, 0.
void meshoptUnfilterOctahedral(std::uint8_t* rows, std::size_t count);

/// Undo the exponential filter in place, for `count` numbers of 32 bits. What is out of the filter's range may become infinite
/// or NaN.
void meshoptUnfilterExponential(std::uint8_t* words, std::size_t count);

}  // namespace terraport
