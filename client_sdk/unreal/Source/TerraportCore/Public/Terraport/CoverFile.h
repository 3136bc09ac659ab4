#pragma once

#include <cstdint>

#include "Terraport/Api.h"
#include "Terraport/SceneFiles.h"
#include "Terraport/Status.h"
#include "Terraport/Types.h"

namespace terraport {

/// Read `base.cover` (scene format, section 8); every truncation and flipped bit is noticed. `baseFaces` are the base mesh's,
/// one row for each; every segment is below `segmentCount`.
TERRAPORTCORE_API Status decodeCover(ByteSpan file, std::uint32_t baseFaces, std::uint32_t segmentCount, Cover& cover);

/// Whether the arrays are what they must be: offsets from 0 to the number of entries, never falling; segments ascending per
/// face, and below `segmentCount`. For covers that did not come through decodeCover.
TERRAPORTCORE_API Status checkCover(const Cover& cover, std::uint32_t segmentCount);

}  // namespace terraport
