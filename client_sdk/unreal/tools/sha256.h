#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

namespace terraport::tools {

/// SHA-256 (FIPS 180-4) as 64 hexadecimal digits: how the corpus names images.
std::string sha256(const std::uint8_t* data, std::size_t size);

}  // namespace terraport::tools
