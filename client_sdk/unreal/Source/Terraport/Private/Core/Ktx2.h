// Images of KTX2 files as a graphics card keeps them (KTX 2.0; BasisLZ with ETC1S, which is what builds write).
#pragma once

#include <cstdint>
#include <vector>

#include "Core/Basics.h"

namespace terraport {

/// Four bits a texel, 8 bytes for 4 x 4 texels; rows of blocks from the image's upper left corner.
enum class BlockForm : std::uint8_t {
  /// Desktops: two colours of 16 bits, and two steps between.
  Bc1,
  /// Phones and headsets: what ETC1S is a part of, so that nothing is lost. ETC2 reads it, too.
  Etc1,
};

struct BlockLevel {
  /// Texels. The last block of a row or column may reach beyond.
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  std::vector<std::uint8_t> blocks;
};

/// Decode all levels, the whole image first. Written by the description in the KTX 2.0 specification (BasisLZ, ETC1S). Error
/// codes: `unsupported` for another kind of KTX2 (UASTC, alpha, layers, cubes), `damaged` where a file is not as it should be.
Status decodeKtx2(ByteSpan file, BlockForm form, std::vector<BlockLevel>& levels);

}  // namespace terraport
