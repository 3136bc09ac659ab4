// scene.json, regions.json and labels.json.
#include "Manifest.h"
#include "mesh_walk.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const terraport::ByteSpan bytes = {data, size};
  terraport::CheckedManifest checked;
  const terraport::Status status = terraport::readManifest(bytes, "fuzz", checked);
  terraport_fuzz::require(status.isOk() || !status.message().empty());
  if (status.isOk()) {
    terraport_fuzz::require(checked.manifest.version.size() == 32 && checked.manifest.segmentCount > 0);
    terraport_fuzz::require(checked.baseGlb.bytes > 0 && checked.totalBytes() < (std::uint64_t{1} << 33));
  }
  const terraport::RegionLabels labels = terraport::readLabels(bytes);
  std::vector<terraport::RegionFacts> regions;
  std::vector<terraport::RegionUnion> unions;
  if (terraport::readRegions(bytes, labels, regions, unions).isOk()) {
    for (std::size_t at = 0; at < regions.size(); ++at) {
      terraport_fuzz::require(regions[at].id == at);
    }
  }
  return 0;
}
