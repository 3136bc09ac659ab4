#include "FlatFile.h"

#include <cstdio>
#include <cstring>
#include <string>

#include "LittleEndian.h"
#include "Terraport/Xxh3.h"
#include "Utf8.h"

namespace terraport {
namespace {

constexpr std::size_t kFlatHeaderBytes = 48;
constexpr std::size_t kEntryBytes = 96;
constexpr std::size_t kNameBytes = 72;
constexpr std::size_t kChecked = 16;
constexpr std::size_t kAlignment = 8;
constexpr std::uint16_t kMajor = 1;

/// Bytes of one value; 0 for a type of a later version.
std::size_t sizeOf(std::uint8_t type) {
  constexpr std::size_t kSizes[] = {0, 1, 1, 2, 2, 4, 4, 8};
  return type < sizeof kSizes / sizeof kSizes[0] ? kSizes[type] : 0;
}

std::string hex(std::uint64_t value) {
  char text[17];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(value));
  return text;
}

}  // namespace

Status FlatFile::read(ByteSpan file, const char* magic) {
  fieldCount_ = 0;
  rows_ = 0;
  if (file.size < kFlatHeaderBytes) {
    return Status::damaged(std::to_string(file.size) + " bytes, expected at least 48 for the header", 0);
  }
  if (std::memcmp(file.data, magic, 8) != 0) {
    return Status::damaged("another magic, expected " + std::string(magic, 8), 0);
  }
  const std::uint16_t major = readU16(file.data + 16);
  if (major != kMajor) {
    return Status::failed("unsupported_version", "format version " + std::to_string(major) + ", expected 1", 16);
  }
  const std::uint64_t stated = readU64(file.data + 24);
  if (stated != file.size) {
    return Status::damaged(std::to_string(file.size) + " bytes, expected " + std::to_string(stated) + " by the header", 24);
  }
  const std::uint64_t checksum = readU64(file.data + 8);
  const std::uint64_t actual = xxh3Hash64({file.data + kChecked, file.size - kChecked});
  if (actual != checksum) {
    return Status::damaged("checksum " + hex(actual) + ", expected " + hex(checksum), 8);
  }
  rows_ = readU32(file.data + 40);
  return readDirectory(file);
}

const FlatField* FlatFile::find(std::string_view name) const {
  for (std::size_t at = 0; at < fieldCount_; ++at) {
    if (fields_[at].name == name) {
      return &fields_[at];
    }
  }
  return nullptr;
}

Status FlatFile::readDirectory(ByteSpan file) {
  const std::uint64_t start = readU32(file.data + 20);
  const std::uint64_t count = readU32(file.data + 32);
  const std::uint64_t entryBytes = readU32(file.data + 36);
  if (count > kMaxFields || entryBytes < kEntryBytes || start < kFlatHeaderBytes) {
    return Status::damaged(std::to_string(count) + " fields of " + std::to_string(entryBytes) + " bytes at " +
            std::to_string(start) + ", expected a directory",
        32);
  }
  if (start + count * entryBytes > file.size) {
    return Status::damaged(
        "a directory of " + std::to_string(count) + " fields runs past the end at " + std::to_string(file.size), 32);
  }
  for (std::uint64_t entry = 0; entry < count; ++entry) {
    TERRAPORT_RETURN_IF_ERROR(readEntry(file, static_cast<std::size_t>(start + entry * entryBytes)));
  }
  return {};
}

Status FlatFile::readEntry(ByteSpan file, std::size_t at) {
  const std::uint8_t* entry = file.data + at;
  const std::uint64_t valueBytes = sizeOf(entry[kNameBytes]);
  if (valueBytes == 0) {
    return {};
  }
  const std::int64_t offset = static_cast<std::int64_t>(at);
  FlatField field;
  field.type = static_cast<FlatType>(entry[kNameBytes]);
  field.components = entry[kNameBytes + 1];
  field.rows = readU32(entry + 76);
  const std::uint64_t first = readU64(entry + 80);
  const std::uint64_t length = readU64(entry + 88);
  // At most 2^32 * 255 * 8: no overflow.
  if (field.components < 1 || length != field.rows * (field.components * valueBytes)) {
    return Status::damaged(std::to_string(length) + " bytes for " + std::to_string(field.rows) + " rows of " +
            std::to_string(field.components) + " x " + std::to_string(valueBytes) + " bytes",
        offset);
  }
  if (first % kAlignment != 0 || first > file.size || length > file.size - first) {
    return Status::damaged("an array at " + std::to_string(first) + " with " + std::to_string(length) +
            " bytes, expected a multiple of 8 within " + std::to_string(file.size),
        offset);
  }
  field.bytes = {file.data + first, static_cast<std::size_t>(length)};
  std::size_t nameBytes = kNameBytes;
  while (nameBytes > 0 && entry[nameBytes - 1] == 0) {
    --nameBytes;
  }
  field.name = {reinterpret_cast<const char*>(entry), nameBytes};
  if (!isUtf8(field.name)) {
    return Status::damaged("a field's name is not UTF-8", offset);
  }
  if (find(field.name) != nullptr) {
    return Status::damaged("field \"" + std::string(field.name) + "\" appears twice", offset);
  }
  fields_[fieldCount_] = field;
  ++fieldCount_;
  return {};
}

}  // namespace terraport
