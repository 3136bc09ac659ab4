// base.cover, and the counters over it: a hostile cover must not lead them astray either.
#include <algorithm>

#include "LittleEndian.h"
#include "Terraport/CoverCounters.h"
#include "Terraport/CoverFile.h"
#include "cover_input.h"
#include "mesh_walk.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  constexpr std::uint32_t kSegments = 4096;
  // More faces, or more entries, would only take the fuzzer's time.
  constexpr std::uint32_t kMostRows = 1U << 16;
  const std::vector<std::uint8_t> file = terraport_fuzz::coverInput(data, size);
  if (size >= 32 && terraport::readU32(file.data() + 28) > kMostRows) {
    return 0;
  }
  const std::uint32_t faces = size >= 32 ? std::min(terraport::readU32(file.data() + 24), kMostRows) : 0;
  terraport::Cover cover;
  if (!terraport::decodeCover(terraport::viewOf(file), faces, kSegments, cover).isOk()) {
    return 0;
  }
  terraport::CoverCounters counters;
  terraport_fuzz::require(counters.begin(cover).isOk() && counters.faceCount() == faces);
  std::vector<std::uint32_t> changed;
  for (std::size_t at = 0; at < std::min<std::size_t>(size, 64); ++at) {
    changed.clear();
    data[at] % 2 == 0 ? counters.add(data[at], changed) : counters.remove(data[at] - 1U, changed);
  }
  std::size_t hidden = 0;
  for (std::uint32_t face = 0; face < faces; ++face) {
    hidden += counters.hidden()[face];
  }
  terraport_fuzz::require(hidden == counters.hiddenCount());
  return 0;
}
