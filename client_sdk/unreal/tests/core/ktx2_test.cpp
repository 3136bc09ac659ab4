// KTX2 images: a small one of the pipeline's encoder, against what Basis Universal's own transcoder makes of it, and damage.
#include "Terraport/Ktx2.h"

#include "../ktx2_file.h"

#include <doctest/doctest.h>

namespace terraport {
namespace {

/// Its first level as ETC1. Decoded, these are the texels of that transcoder's RGBA, each.
const char* const kEtc1 =
    "6860582673237fed686058268864c1c690887026ee0fdd39b0a8906e00ff60447068584a7e0a20407068584a31161d80b0a0906e333f8d1f"
    "b8b0984a1ff76673";
const char* const kBc1 =
    "ad7b895a59574080ad7b895a8aac2572f0a4cc8301f35b59b7de0d8caf2f25af4e946752ea7bf2bb4e9467525eeb8b8277decd8bd5fd8909"
    "96decf9cf51517be";

Status decode(const std::vector<std::uint8_t>& file, BlockForm form, std::vector<BlockLevel>& levels) {
  return decodeKtx2({file.data(), file.size()}, form, levels);
}

}  // namespace

TEST_CASE("an image of the encoder has all levels, in either form") {
  std::vector<BlockLevel> levels;
  REQUIRE(decode(bytesOfHex(kFile), BlockForm::Etc1, levels).isOk());
  REQUIRE(levels.size() == 5);
  CHECK(levels[0].blocks == bytesOfHex(kEtc1));
  CHECK(levels[1].width == 8);
  CHECK(levels[1].height == 4);
  CHECK(levels[1].blocks.size() == 16);
  CHECK(levels[4].width == 1);
  CHECK(levels[4].blocks.size() == 8);
  REQUIRE(decode(bytesOfHex(kFile), BlockForm::Bc1, levels).isOk());
  CHECK(levels[0].blocks == bytesOfHex(kBc1));
}

TEST_CASE("a file that is cut off anywhere is refused or whole, and so is one with a wrong byte") {
  const std::vector<std::uint8_t> whole = bytesOfHex(kFile);
  std::vector<BlockLevel> levels;
  std::size_t refused = 0;
  for (std::size_t length = 0; length < whole.size(); ++length) {
    // A vector of that length: what reads beyond it is seen by the sanitizer.
    const std::vector<std::uint8_t> cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(length));
    refused += decode(cut, BlockForm::Etc1, levels).isOk() ? 0 : 1;
  }
  // The first level stands last, so that every byte is needed.
  CHECK(refused == whole.size());
  for (std::size_t at = 0; at < whole.size(); ++at) {
    for (const std::uint8_t flip : {0x01, 0x80, 0xFF}) {
      std::vector<std::uint8_t> other = whole;
      other[at] = static_cast<std::uint8_t>(other[at] ^ flip);
      if (decode(other, BlockForm::Bc1, levels).isOk()) {
        CHECK(levels.size() <= 13);
      } else {
        CHECK(levels.empty());
      }
    }
  }
}

TEST_CASE("kinds of KTX2 that builds do not write are told apart from damage") {
  std::vector<BlockLevel> levels;
  std::vector<std::uint8_t> other = bytesOfHex(kFile);
  other[44] = 2;  // Zstandard in place of BasisLZ
  CHECK(decode(other, BlockForm::Etc1, levels).code() == "unsupported");
  other = bytesOfHex(kFile);
  other[0] = 0;
  CHECK(decode(other, BlockForm::Etc1, levels).code() == "damaged");
}

}  // namespace terraport
