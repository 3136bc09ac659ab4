// The codecs by themselves: one byte says which, two the number of rows, the rest is the stream, whose first byte is set right.
// With libmeshoptimizer (-DTERRAPORT_FUZZ_AGAINST_MESHOPTIMIZER, linked with -lmeshoptimizer) both must say the same.
#include <cstring>
#include <vector>

#include "LittleEndian.h"
#include "Meshopt.h"
#include "mesh_walk.h"

#if defined(TERRAPORT_FUZZ_AGAINST_MESHOPTIMIZER)
#include <meshoptimizer.h>
#endif

namespace {

void compareVertices(const std::vector<std::uint8_t>& stream, std::size_t count, std::size_t stride, bool isOurs,
    const std::vector<std::uint8_t>& decoded) {
#if defined(TERRAPORT_FUZZ_AGAINST_MESHOPTIMIZER)
  std::vector<std::uint8_t> theirs(count * stride);
  const int code = meshopt_decodeVertexBuffer(theirs.data(), count, stride, stream.data(), stream.size());
  terraport_fuzz::require((code == 0) == isOurs && (!isOurs || theirs == ours));
#else
  (void)stream, (void)count, (void)stride, (void)isOurs, (void)decoded;
#endif
}

void compareTriangles(
    const std::vector<std::uint8_t>& stream, std::size_t count, bool isOurs, const std::vector<std::uint32_t>& decoded) {
#if defined(TERRAPORT_FUZZ_AGAINST_MESHOPTIMIZER)
  std::vector<std::uint32_t> theirs(count);
  const int code = meshopt_decodeIndexBuffer(theirs.data(), count, 4, stream.data(), stream.size());
  terraport_fuzz::require((code == 0) == isOurs && (!isOurs || theirs == ours));
#else
  (void)stream, (void)count, (void)isOurs, (void)decoded;
#endif
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 4) {
    return 0;
  }
  const std::uint8_t kind = data[0];
  const std::size_t count = 1 + terraport::readU16(data + 1) % 2048;
  std::vector<std::uint8_t> stream(data + 3, data + size);
  stream.shrink_to_fit();
  if (kind % 8 < 4) {
    const std::size_t stride = 4 * (kind % 4 + std::size_t{1});
    stream[0] = terraport::kMeshoptVertexCodec;
    std::vector<std::uint8_t> rows(count * stride);
    const bool isGood = terraport::meshoptDecodeVertices(terraport::viewOf(stream), count, stride, rows.data());
    compareVertices(stream, count, stride, isGood, rows);
    terraport::meshoptUnfilterOctahedral(rows.data(), rows.size() / 4);
    terraport::meshoptUnfilterExponential(rows.data(), rows.size() / 4);
    return 0;
  }
  stream[0] = terraport::kMeshoptIndexCodec;
  std::vector<std::uint32_t> indices(count * 3);
  const bool isGood = terraport::meshoptDecodeTriangles(terraport::viewOf(stream), indices.size(), indices.data());
  compareTriangles(stream, indices.size(), isGood, indices);
  return 0;
}
