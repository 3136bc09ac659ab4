// Images of KTX2 files.
#include "Terraport/Ktx2.h"

#include "mesh_walk.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::vector<terraport::BlockLevel> levels;
  const auto form = (size & 1) != 0 ? terraport::BlockForm::Bc1 : terraport::BlockForm::Etc1;
  const terraport::Status status = terraport::decodeKtx2({data, size}, form, levels);
  terraport_fuzz::require(status.isOk() ? !levels.empty() : levels.empty() && !status.message().empty());
  for (const terraport::BlockLevel& level : levels) {
    terraport_fuzz::require(level.blocks.size() == std::size_t{8} * ((level.width + 3) / 4) * ((level.height + 3) / 4));
  }
  return 0;
}
