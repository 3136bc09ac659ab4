// Segments. An input that starts with "TSG2" is one; any other is two bytes of length, planes, and an image of so many bytes,
// which are packed with checksums that are right.
#include <zlib.h>

#include <algorithm>
#include <cstring>

#include "LittleEndian.h"
#include "SegmentFormat.h"
#include "mesh_walk.h"

namespace {

constexpr std::size_t kChecksumAt = 36;

void write32(std::uint8_t* at, std::size_t value) {
  for (int byte = 0; byte < 4; ++byte) {
    at[byte] = static_cast<std::uint8_t>(value >> (8 * byte));
  }
}

std::vector<std::uint8_t> packed(const std::uint8_t* data, std::size_t size) {
  const std::size_t imageBytes = size < 2 ? 0 : std::min<std::size_t>(terraport::readU16(data), size - 2);
  const std::uint8_t* const image = data + size - imageBytes;
  std::vector<std::uint8_t> planes(data + std::min<std::size_t>(size, 2), image);
  if (planes.size() >= kChecksumAt + 4) {
    write32(&planes[kChecksumAt], crc32(0, image, static_cast<uInt>(imageBytes)));
  }
  z_stream deflater = {};
  terraport_fuzz::require(deflateInit2(&deflater, 1, Z_DEFLATED, MAX_WBITS + 16, 8, Z_DEFAULT_STRATEGY) == Z_OK);
  std::vector<std::uint8_t> out(12 + deflateBound(&deflater, static_cast<uLong>(planes.size())));
  deflater.next_in = planes.data();
  deflater.avail_in = static_cast<uInt>(planes.size());
  deflater.next_out = &out[12];
  deflater.avail_out = static_cast<uInt>(out.size() - 12);
  terraport_fuzz::require(deflate(&deflater, Z_FINISH) == Z_STREAM_END);
  out.resize(12 + deflater.total_out);
  deflateEnd(&deflater);
  std::memcpy(out.data(), "TSG2", 4);
  write32(&out[4], out.size() - 12);
  write32(&out[8], imageBytes);
  out.insert(out.end(), image, image + imageBytes);
  return out;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  // Used again and again, as a client uses them.
  static terraport::SegmentDecoder decoder;
  static terraport::SegmentMesh mesh;
  static const std::vector<terraport::AttributeInfo> attributes(2);
  const bool isWhole = size >= 4 && std::memcmp(data, "TSG2", 4) == 0;
  std::vector<std::uint8_t> payload = isWhole ? std::vector<std::uint8_t>(data, data + size) : packed(data, size);
  payload.shrink_to_fit();
  const terraport::Status status = decoder.decode(terraport::viewOf(payload), attributes, 1, mesh);
  terraport_fuzz::walk(status, mesh, terraport::viewOf(payload));
  return 0;
}
