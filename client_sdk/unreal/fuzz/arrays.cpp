// Arrays payloads.
#include "Terraport/ArraysDecoder.h"
#include "flat_input.h"
#include "mesh_walk.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static terraport::ArraysDecoder decoder;
  static terraport::SegmentMesh mesh;
  const std::vector<std::uint8_t> payload = terraport_fuzz::flatInput(data, size);
  const terraport::Status status = decoder.decode(terraport::viewOf(payload), size % 2 == 0 ? 1 : -1, mesh);
  terraport_fuzz::walk(status, mesh, terraport::viewOf(payload));
  return 0;
}
