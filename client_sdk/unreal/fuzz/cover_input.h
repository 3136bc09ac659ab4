// A cover made of a fuzzer's input: its checksum is set right in three of four, or nothing beyond it would ever be reached.
#pragma once

#include <cstdint>
#include <vector>

#include "Terraport/Types.h"
#include "Terraport/Xxh3.h"

namespace terraport_fuzz {

inline std::vector<std::uint8_t> coverInput(const std::uint8_t* data, std::size_t size) {
  std::vector<std::uint8_t> file(data, data + size);
  file.shrink_to_fit();
  if (size >= 16 && data[size - 1] % 4 != 0) {
    const std::uint64_t check = terraport::xxh3Hash64({file.data() + 16, size - 16});
    for (std::size_t byte = 0; byte < 8; ++byte) {
      file[8 + byte] = static_cast<std::uint8_t>(check >> (8 * byte));
    }
  }
  return file;
}

}  // namespace terraport_fuzz
