// Payloads: planes, image headers, KTX2, and rays against what was decoded.
#include <cstdio>

#include "Core/Ground.h"
#include "Core/Ktx2.h"
#include "Core/Segment.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace terraport;
  if (size == 0) return 0;
  static SegmentDecoder decoder;
  static SegmentMesh mesh;
  const ByteSpan payload(data + 1, size - 1);
  const auto kind = (data[0] & 1) != 0 ? SegmentDecoder::Kind::Base : SegmentDecoder::Kind::Segment;
  if (!decoder.decode(payload, data[0] >> 1 & 31, kind, mesh).isOk()) return 0;
  GroundPoint point;
  point.at = 1e9;
  (void)GroundMesh(mesh).cast({0, 1000, 0}, {0, -1, 0}, nullptr, point);
  std::vector<BlockLevel> levels;
  if (mesh.image.kind == ImageKind::Ktx2) (void)decodeKtx2(mesh.image.fileOf(payload), BlockForm::Bc1, levels).isOk();
  return 0;
}
