#pragma once

#include <cstdint>

#include "Terraport/Api.h"
#include "Terraport/Types.h"

namespace terraport {

/// XXH3 with 64 bits and seed 0, of any number of bytes: the hash of every file and payload of a scene.
TERRAPORTCORE_API std::uint64_t xxh3Hash64(ByteSpan bytes);

}  // namespace terraport
