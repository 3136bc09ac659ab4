// GLBs, as base meshes are. An input that starts with "glTF" is a GLB whose total length is set right; any other is two bytes
// of length, a JSON chunk of so many bytes, and a BIN chunk, so that mutations of either leave the container whole.
#include <algorithm>
#include <cstring>

#include "LittleEndian.h"
#include "Terraport/GlbDecoder.h"
#include "mesh_walk.h"

namespace {

void append32(std::vector<std::uint8_t>& out, std::size_t value) {
  for (int shift = 0; shift < 32; shift += 8) {
    out.push_back(static_cast<std::uint8_t>(value >> shift));
  }
}

std::vector<std::uint8_t> assembled(const std::uint8_t* data, std::size_t size) {
  const std::size_t json = size < 2 ? 0 : std::min<std::size_t>(terraport::readU16(data), size - 2);
  const std::uint8_t* text = data + (size < 2 ? size : 2);
  const std::uint8_t* const end = data + size;
  std::vector<std::uint8_t> out = {'g', 'l', 'T', 'F', 2, 0, 0, 0};
  const std::size_t binary = static_cast<std::size_t>(end - text) - json;
  append32(out, 12 + 8 + json + 8 + binary);
  append32(out, json);
  append32(out, 0x4e4f534a);
  out.insert(out.end(), text, text + json);
  append32(out, binary);
  append32(out, 0x004e4942);
  out.insert(out.end(), text + json, end);
  return out;
}

std::vector<std::uint8_t> withLength(const std::uint8_t* data, std::size_t size) {
  std::vector<std::uint8_t> out(data, data + size);
  for (std::size_t at = 0; at < 4 && size >= 12; ++at) {
    out[8 + at] = static_cast<std::uint8_t>(size >> (8 * at));
  }
  return out;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  // Used again and again, as a client uses them.
  static terraport::GlbDecoder decoder;
  static terraport::SegmentMesh mesh;
  const bool isWhole = size >= 4 && std::memcmp(data, "glTF", 4) == 0;
  std::vector<std::uint8_t> payload = isWhole ? withLength(data, size) : assembled(data, size);
  payload.shrink_to_fit();
  const terraport::Status status = decoder.decode(terraport::viewOf(payload), mesh);
  terraport_fuzz::walk(status, mesh, terraport::viewOf(payload));
  return 0;
}
