// JPEG (ITU-T T.81, annex B), PNG (ISO 15948, 5.2 and 11.2.2), WebP (RFC 9649, 2.3 to 2.7), KTX2 (Khronos KTX File Format 2.0,
// section 3).
#include "Core/ImageHeader.h"

#include <algorithm>
#include <cstring>
#include <string>

namespace terraport {
namespace {

constexpr std::uint8_t kJpeg[] = {0xff, 0xd8, 0xff};
constexpr std::uint8_t kPng[] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
constexpr std::uint8_t kKtx2[] = {0xab, 'K', 'T', 'X', ' ', '2', '0', 0xbb, '\r', '\n', 0x1a, '\n'};
/// The scheme of ETC1S; UASTC has others.
constexpr std::uint32_t kBasisLz = 1;

std::uint32_t readU16Big(const std::uint8_t* at) {
  return (std::uint32_t{at[0]} << 8) | at[1];
}

std::uint32_t readU32Big(const std::uint8_t* at) {
  return (readU16Big(at) << 16) | readU16Big(at + 2);
}

void set(SegmentImage& image, ImageKind kind, std::uint32_t width, std::uint32_t height) {
  image.kind = kind;
  image.width = width;
  image.height = height;
}

Status cutShort(std::size_t size) {
  return Status::damaged("image header cut short after " + std::to_string(size) + " bytes");
}

template <std::size_t N>
bool startsWith(ByteSpan file, const std::uint8_t (&start)[N]) {
  return file.size >= N && std::memcmp(file.data, start, N) == 0;
}

/// Four letters at an offset whose bytes exist.
bool hasLetters(ByteSpan file, std::size_t at, const char* letters) {
  return std::memcmp(file.data + at, letters, 4) == 0;
}

Status readJpeg(ByteSpan file, SegmentImage& image) {
  std::size_t at = 2;
  // Each round moves on by a byte or more.
  while (at + 4 <= file.size) {
    if (file.data[at] != 0xff) return Status::damaged("JPEG without a marker at " + std::to_string(at));
    const std::uint8_t marker = file.data[at + 1];
    if (marker == 0xff) {
      at += 1;  // a fill byte
    } else if (marker == 0x01 || (marker >= 0xd0 && marker <= 0xd7)) {
      at += 2;  // TEM and the restarts have no length
    } else if (marker == 0xd9 || marker == 0xda) {
      break;
    } else if (marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc) {
      // A frame; DHT, JPG and DAC lie between them.
      if (at + 9 > file.size) return cutShort(file.size);
      set(image, ImageKind::Jpeg, readU16Big(file.data + at + 7), readU16Big(file.data + at + 5));
      return {};
    } else {
      at += 2 + std::max<std::size_t>(readU16Big(file.data + at + 2), 2);
    }
  }
  return Status::damaged("JPEG without a frame header before its first scan");
}

std::uint32_t readU24(const std::uint8_t* at) {
  return readU16(at) | (std::uint32_t{at[2]} << 16);
}

Status readWebp(ByteSpan file, SegmentImage& image) {
  // What the longest of the three headers takes.
  const bool hasVp8 = file.size >= 30;
  image.kind = ImageKind::Webp;
  if (file.size >= 16 && hasLetters(file, 12, "VP8 ")) {
    if (!hasVp8) return cutShort(file.size);
    image.width = readU16(file.data + 26) & 0x3fffU;
    image.height = readU16(file.data + 28) & 0x3fffU;
    return {};
  }
  if (file.size >= 16 && hasLetters(file, 12, "VP8L")) {
    if (file.size < 25) return cutShort(file.size);
    const std::uint32_t bits = readU32(file.data + 21);
    image.width = (bits & 0x3fffU) + 1;
    image.height = ((bits >> 14) & 0x3fffU) + 1;
    return {};
  }
  if (file.size >= 16 && hasLetters(file, 12, "VP8X")) {
    if (!hasVp8) return cutShort(file.size);
    image.width = readU24(file.data + 24) + 1;
    image.height = readU24(file.data + 27) + 1;
    return {};
  }
  return Status::damaged("WebP without VP8, VP8L or VP8X as its first chunk");
}

Status readAny(ByteSpan file, SegmentImage& image) {
  if (startsWith(file, kJpeg)) return readJpeg(file, image);
  if (startsWith(file, kPng)) {
    if (file.size < 24) return cutShort(file.size);
    if (!hasLetters(file, 12, "IHDR")) return Status::damaged("PNG does not start with IHDR");
    set(image, ImageKind::Png, readU32Big(file.data + 16), readU32Big(file.data + 20));
    return {};
  }
  if (startsWith(file, kKtx2)) {
    // Behind the identifier (12 bytes): vkFormat, typeSize, the two sides, depth, layers, faces, levels,
    // supercompressionScheme.
    if (file.size < 48) return cutShort(file.size);
    set(image, ImageKind::Ktx2, readU32(file.data + 20), readU32(file.data + 24));
    image.texelBits = readU32(file.data + 44) == kBasisLz ? 4 : 8;
    return {};
  }
  if (file.size >= 12 && hasLetters(file, 0, "RIFF") && hasLetters(file, 8, "WEBP")) return readWebp(file, image);
  return Status::damaged("image of unknown type, expected JPEG, PNG, WebP or KTX2 by its first bytes");
}

}  // namespace

Status readImageHeader(ByteSpan file, std::uint32_t mostSide, SegmentImage& image) {
  Status status = readAny(file, image);
  if (!status.isOk()) return status;
  for (const std::uint32_t side : {image.width, image.height}) {
    if (side < 1 || side > mostSide || (side & (side - 1)) != 0) {
      return Status::damaged("image of " + std::to_string(image.width) + " x " + std::to_string(image.height) +
          " pixels, expected powers of two, at most " + std::to_string(mostSide));
    }
  }
  return {};
}

}  // namespace terraport
