// A flat file made of a fuzzer's input: its length and checksum are set right in three of four, or nothing beyond them would
// ever be reached.
#pragma once

#include <cstdint>
#include <vector>

#include "Terraport/Types.h"
#include "Terraport/Xxh3.h"

namespace terraport_fuzz {

inline std::vector<std::uint8_t> flatInput(const std::uint8_t* data, std::size_t size) {
  std::vector<std::uint8_t> file(data, data + size);
  file.shrink_to_fit();
  const auto put = [&](std::size_t at, std::uint64_t value) {
    for (std::size_t byte = 0; byte < 8; ++byte) {
      file[at + byte] = static_cast<std::uint8_t>(value >> (8 * byte));
    }
  };
  if (size >= 48 && data[size - 1] % 4 != 0) {
    put(24, size);
    put(8, terraport::xxh3Hash64({file.data() + 16, size - 16}));
  }
  return file;
}

}  // namespace terraport_fuzz
