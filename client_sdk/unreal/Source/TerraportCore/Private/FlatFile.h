// A file of named arrays behind a directory, with a checksum (scene format, section 5): base.cover.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

#include "Terraport/Status.h"
#include "Terraport/Types.h"

namespace terraport {

enum class FlatType : std::uint8_t { Int8 = 1, Uint8, Int16, Uint16, Uint32, Float32, Uint64 };

/// One array of a flat file: a view of the file's bytes.
struct FlatField {
  /// UTF-8.
  std::string_view name;
  FlatType type = FlatType::Uint8;
  std::uint32_t components = 1;
  std::uint32_t rows = 0;
  /// Little-endian; rows * components values, not necessarily aligned in memory.
  ByteSpan bytes;
};

/// A flat file: a view of its bytes. Reading allocates nothing.
class FlatFile {
 public:
  static constexpr std::size_t kMaxFields = 256;

  /// Read and look at everything: every flipped bit and every truncation is noticed. `magic` has eight characters.
  Status read(ByteSpan file, const char* magic);

  /// The header's number of segments, base faces or vertices.
  std::uint32_t rows() const { return rows_; }
  /// Null where there is none of that name.
  const FlatField* find(std::string_view name) const;

 private:
  Status readDirectory(ByteSpan file);
  Status readEntry(ByteSpan file, std::size_t at);

  FlatField fields_[kMaxFields];
  std::size_t fieldCount_ = 0;
  std::uint32_t rows_ = 0;
};

}  // namespace terraport
