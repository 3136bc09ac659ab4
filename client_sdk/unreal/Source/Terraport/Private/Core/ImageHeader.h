#pragma once

#include "Core/Segment.h"

namespace terraport {

/// Read kind, sides and bits of a texel from the header of an image file. Sides that are not powers of two, or larger than
/// `mostSide`, are refused: the header is read before an image library sees the file.
Status readImageHeader(ByteSpan file, std::uint32_t mostSide, SegmentImage& image);

}  // namespace terraport
