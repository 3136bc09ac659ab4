#include "Terraport/CoverFile.h"

#include <cstring>
#include <memory>
#include <string>

#include "FlatFile.h"

namespace terraport {
namespace {

Status readColumn(const FlatFile& file, const char* name, std::vector<std::uint32_t>& out) {
  const FlatField* field = file.find(name);
  if (field == nullptr || field->type != FlatType::Uint32 || field->components != 1) {
    return Status::damaged(std::string("no field ") + name + " of uint32 in the cover");
  }
  out.resize(field->rows);
  if (!out.empty()) {
    std::memcpy(out.data(), field->bytes.data, field->bytes.size);
  }
  return {};
}

}  // namespace

Status decodeCover(ByteSpan file, std::uint32_t baseFaces, std::uint32_t segmentCount, Cover& cover) {
  cover.offsets.clear();
  cover.segments.clear();
  // 20 KiB: too much for a small stack.
  const std::unique_ptr<FlatFile> flat(new FlatFile);
  TERRAPORT_RETURN_IF_ERROR(flat->read(file, "TPCOVER1"));
  TERRAPORT_RETURN_IF_ERROR(readColumn(*flat, "offsets", cover.offsets));
  TERRAPORT_RETURN_IF_ERROR(readColumn(*flat, "segments", cover.segments));
  if (flat->rows() != baseFaces || cover.offsets.size() != std::size_t{baseFaces} + 1) {
    return Status::damaged("cover of " + std::to_string(flat->rows()) + " rows with " + std::to_string(cover.offsets.size()) +
        " offsets, expected " + std::to_string(baseFaces) + ": one a base face");
  }
  return checkCover(cover, segmentCount);
}

Status checkCover(const Cover& cover, std::uint32_t segmentCount) {
  const std::vector<std::uint32_t>& offsets = cover.offsets;
  const std::vector<std::uint32_t>& segments = cover.segments;
  if (offsets.empty() || offsets.front() != 0 || offsets.back() != segments.size()) {
    return Status::damaged("cover offsets do not run from 0 to " + std::to_string(segments.size()));
  }
  // All of them before any row is read: until then an offset may point anywhere.
  for (std::size_t face = 0; face + 1 < offsets.size(); ++face) {
    if (offsets[face + 1] < offsets[face]) {
      return Status::damaged("cover offsets decrease at base face " + std::to_string(face) + ", expected ascending");
    }
  }
  for (std::size_t face = 0; face + 1 < offsets.size(); ++face) {
    for (std::size_t at = offsets[face]; at < offsets[face + 1]; ++at) {
      if (segments[at] >= segmentCount) {
        return Status::damaged(
            "segment " + std::to_string(segments[at]) + " in the cover, expected below " + std::to_string(segmentCount));
      }
      if (at > offsets[face] && segments[at] <= segments[at - 1]) {
        return Status::damaged(
            "segments over base face " + std::to_string(face) + " do not ascend, expected each once, ascending");
      }
    }
  }
  return {};
}

}  // namespace terraport
