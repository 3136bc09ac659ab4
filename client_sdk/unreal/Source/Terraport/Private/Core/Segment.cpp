#include "Core/Segment.h"

#include <zlib.h>

#include <algorithm>
#include <bitset>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <initializer_list>
#include <limits>

#include "Core/ImageHeader.h"

namespace terraport {
namespace {

constexpr std::size_t kOuterBytes = 12;
constexpr std::size_t kHeadBytes = 40;
constexpr std::size_t kMaxStreamBytes = std::size_t{1} << 28;
/// DEFLATE makes at most 1032 bytes out of one.
constexpr std::size_t kMaxExpansion = 1032;
/// Header and trailer of a gzip stream.
constexpr std::size_t kGzipBytes = 18;
constexpr unsigned kColours = 1, kUvs = 2, kRegions = 4, kWide = 8;
constexpr std::uint16_t kNoRegion = 65535;
/// Whole steps below it are exact in float32.
constexpr std::int64_t kMaxSteps = 1 << 24;
constexpr int kMaxStepExponent = 103;  // 2^24 such steps are finite in float32
constexpr std::uint32_t kMaxSegmentSide = 2048, kMaxBaseSide = 4096;

std::uint64_t bitPlaneBytes(std::uint64_t count) {
  return (count + 7) / 8;
}

bool bitAt(const std::uint8_t* plane, std::size_t at) {
  return ((plane[at / 8] >> (at % 8)) & 1) != 0;
}

std::size_t countOnes(const std::uint8_t* plane, std::size_t count) {
  std::size_t ones = 0;
  for (std::size_t byte = 0; byte < count / 8; ++byte) ones += std::bitset<8>(plane[byte]).count();
  for (std::size_t bit = count / 8 * 8; bit < count; ++bit) ones += bitAt(plane, bit) ? 1 : 0;
  return ones;
}

/// Give each value of a plane of `count` differences of `width` bytes to `put(at, value)`.
template <unsigned width, typename Put>
void sumDifferences(const std::uint8_t* plane, std::size_t count, Put put) {
  std::uint32_t value = 0;
  for (std::size_t at = 0; at < count; ++at) {
    std::uint32_t code = 0;
    for (unsigned byte = 0; byte < width; ++byte) code |= std::uint32_t{plane[byte * count + at]} << (8 * byte);
    value += (code >> 1) ^ (0 - (code & 1));
    put(at, width == 4 ? value : value & ((1U << (8 * width % 32)) - 1));
  }
}

}  // namespace

/// One segment being read.
class SegmentReading {
 public:
  SegmentReading(SegmentDecoder& decoder, SegmentMesh& mesh) : decoder_(decoder), mesh_(mesh) {}

  Status read(ByteSpan payload, std::size_t attributes, SegmentDecoder::Kind kind) {
    if (payload.size < kOuterBytes || std::memcmp(payload.data, "TSG2", 4) != 0) {
      return Status::damaged("segment of " + std::to_string(payload.size) + " bytes, expected TSG2 and at least 8 more");
    }
    const std::uint64_t packedBytes = readU32(payload.data + 4);
    if (payload.size != kOuterBytes + packedBytes + readU32(payload.data + 8)) {
      return Status::damaged("segment of " + std::to_string(payload.size) + " bytes, expected as its head says");
    }
    const auto imageOffset = static_cast<std::size_t>(kOuterBytes + packedBytes);
    const ByteSpan packed = {payload.data + kOuterBytes, imageOffset - kOuterBytes};
    // The last four bytes of gzip say how long the stream is; zlib compares that, and the checksum, with what it inflates.
    const std::size_t size = packed.size < kGzipBytes ? 0 : readU32(packed.data + packed.size - 4);
    const bool canBe = size >= kHeadBytes && size <= kMaxStreamBytes && size / kMaxExpansion <= packed.size;
    if (!canBe || !decoder_.inflater_.inflateGzip(packed, size, decoder_.stream_)) {
      return Status::damaged("planes are damaged, cut off or too long");
    }
    head_ = decoder_.stream_.data();
    Status status = readHead(attributes, kind);
    if (status.isOk()) status = readImage(payload, imageOffset, kind);
    if (status.isOk()) status = findPlanes();
    if (status.isOk()) status = readFaces();
    if (status.isOk()) status = readPositions();
    if (status.isOk()) status = readOtherColumns(attributes);
    return status;
  }

 private:
  Status readHead(std::size_t attributes, SegmentDecoder::Kind kind) {
    mesh_.vertexCount = readU32(head_);
    mesh_.faceCount = readU32(head_ + 4);
    flags_ = head_[21];
    mask_ = readU32(head_ + 32);
    const unsigned known = kColours | kUvs | kRegions | (kind == SegmentDecoder::Kind::Base ? kWide : 0);
    if (mesh_.vertexCount == 0 || mesh_.faceCount == 0 || (flags_ & ~known) != 0 ||
        (flags_ & (kColours | kUvs)) == (kColours | kUvs) || (attributes < 32 && (mask_ >> attributes) != 0)) {
      return Status::damaged("segment with flags " + std::to_string(flags_) + " and attributes " + std::to_string(mask_) +
          ", expected known flags, attributes of the scene, and a face");
    }
    return {};
  }

  Status readImage(ByteSpan payload, std::size_t offset, SegmentDecoder::Kind kind) {
    const ByteSpan file = {payload.data + offset, payload.size - offset};
    const unsigned stated = head_[22];
    const bool isExpected = (flags_ & kUvs) != 0;
    mesh_.image = SegmentImage();
    if (stated > 4 || (stated != 0) != isExpected || (file.size != 0) != isExpected ||
        crc32(0, file.data, static_cast<uInt>(file.size)) != readU32(head_ + 36)) {
      return Status::damaged("an image that is damaged, missing or of an unknown kind");
    }
    if (!isExpected) return {};
    SegmentImage& image = mesh_.image;
    Status status = readImageHeader(file, kind == SegmentDecoder::Kind::Base ? kMaxBaseSide : kMaxSegmentSide, image);
    if (!status.isOk()) return status;
    image.offset = offset;
    image.bytes = file.size;
    if (image.kind != static_cast<ImageKind>(stated) || image.width != readU16(head_ + 26) ||
        image.height != readU16(head_ + 28)) {
      return Status::damaged("an image of another type or size than the segment says");
    }
    return {};
  }

  /// Find the planes of faces. Fails unless the stream has exactly the bytes of all planes: none is compared later.
  Status findPlanes() {
    const std::uint64_t size = decoder_.stream_.size();
    const std::uint64_t vertices = mesh_.vertexCount;
    const std::uint64_t faceBytes = bitPlaneBytes(mesh_.faceCount);
    starts_ = head_ + kHeadBytes;
    if (size < kHeadBytes + faceBytes) return Status::damaged("planes are cut off");
    corners_ = mesh_.faceCount + std::uint64_t{2} * countOnes(starts_, mesh_.faceCount);
    const std::uint64_t oldBytes = corners_ < vertices ? 0 : (vertices <= 65536 ? 2 : 4) * (corners_ - vertices);
    const std::uint64_t vertexBytes = ((flags_ & kWide) != 0 ? 14 : 8) + ((flags_ & kColours) != 0 ? 3 : 0) +
        ((flags_ & kUvs) != 0 ? 4 : 0) + ((flags_ & kRegions) != 0 ? 2 : 0) + 2 * std::bitset<32>(mask_).count();
    const std::uint64_t all = kHeadBytes + 2 * faceBytes + bitPlaneBytes(corners_) + oldBytes + vertices * vertexBytes;
    if (size != all) return Status::damaged("planes of " + std::to_string(size) + " bytes, expected " + std::to_string(all));
    lefts_ = starts_ + faceBytes;
    news_ = lefts_ + faceBytes;
    next_ = news_ + bitPlaneBytes(corners_);
    if (!bitAt(starts_, 0) || countOnes(news_, static_cast<std::size_t>(corners_)) != vertices) {
      return Status::damaged("faces that begin no strip, or name other than " + std::to_string(vertices) + " vertices");
    }
    return {};
  }

  /// Read the next plane of differences.
  template <unsigned width, typename Put>
  void readPlane(std::size_t count, Put put) {
    sumDifferences<width>(next_, count, put);
    next_ += count * width;
  }

  /// Read planes of one byte a vertex; the k-th goes to place `places[k]` of three.
  template <typename T>
  void readTriples(std::initializer_list<std::size_t> places, std::vector<T>& out) {
    out.resize(3 * std::size_t{mesh_.vertexCount});
    for (const std::size_t place : places) {
      readPlane<1>(
          mesh_.vertexCount, [&](std::size_t at, std::uint32_t value) { out[3 * at + place] = static_cast<T>(value); });
    }
  }

  Status readFaces() {
    const auto oldCount = static_cast<std::size_t>(corners_ - mesh_.vertexCount);
    std::vector<std::uint32_t>& olds = decoder_.oldCorners_;
    olds.resize(oldCount);
    const auto put = [&olds](std::size_t at, std::uint32_t value) { olds[at] = value; };
    mesh_.vertexCount <= 65536 ? readPlane<2>(oldCount, put) : readPlane<4>(oldCount, put);
    mesh_.indices.resize(3 * std::size_t{mesh_.faceCount});
    const std::uint32_t* old = olds.data();
    std::uint32_t fresh = 0;
    std::size_t corner = 0;
    bool isEarly = false;
    const auto nextCorner = [&] {
      const bool isNew = bitAt(news_, corner);
      ++corner;
      const std::uint32_t vertex = isNew ? fresh++ : *old++;
      isEarly = isEarly || vertex >= fresh;
      return vertex;
    };
    std::uint32_t* out = mesh_.indices.data();
    std::uint32_t first = 0, second = 0, third = 0;
    for (std::size_t face = 0; face < mesh_.faceCount; ++face, out += 3) {
      if (bitAt(starts_, face)) {
        first = nextCorner();
        second = nextCorner();
      } else {
        (bitAt(lefts_, face) ? second : first) = third;
      }
      third = nextCorner();
      out[0] = first;
      out[1] = second;
      out[2] = third;
    }
    return isEarly ? Status::damaged("a face with a vertex that is not there yet") : Status();
  }

  Status readPositions() {
    const auto exponent = static_cast<std::int8_t>(head_[20]);
    if (exponent > kMaxStepExponent) return Status::damaged("steps above 2^103 m, expected positions in float32");
    const double stepM = std::ldexp(1.0, exponent);
    mesh_.positions.resize(3 * std::size_t{mesh_.vertexCount});
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto origin = static_cast<std::int32_t>(readU32(head_ + 8 + 4 * axis));
      std::int64_t low = std::numeric_limits<std::int64_t>::max(), high = std::numeric_limits<std::int64_t>::min();
      const auto put = [&](std::size_t at, std::uint32_t value) {
        const std::int64_t steps = std::int64_t{origin} + value;
        low = std::min(low, steps);
        high = std::max(high, steps);
        mesh_.positions[3 * at + axis] = static_cast<float>(static_cast<double>(steps) * stepM);
      };
      (flags_ & kWide) != 0 ? readPlane<4>(mesh_.vertexCount, put) : readPlane<2>(mesh_.vertexCount, put);
      if (low <= -kMaxSteps || high >= kMaxSteps) {
        return Status::damaged("a position 2^24 steps or more from the scene's origin, expected less");
      }
      mesh_.bounds.low[axis] = static_cast<float>(static_cast<double>(low) * stepM);
      mesh_.bounds.high[axis] = static_cast<float>(static_cast<double>(high) * stepM);
    }
    return {};
  }

  Status readOtherColumns(std::size_t attributes) {
    const std::size_t count = mesh_.vertexCount;
    readTriples({0, 2}, mesh_.normals);
    unfoldNormals();
    mesh_.colours.clear();
    if ((flags_ & kColours) != 0) {
      readTriples({1, 0, 2}, mesh_.colours);
      for (std::size_t at = 0; at < mesh_.colours.size(); at += 3) {
        for (const std::size_t other : {at, at + 2}) {
          mesh_.colours[other] = static_cast<std::uint8_t>(mesh_.colours[other] + mesh_.colours[at + 1]);
        }
      }
    }
    mesh_.uvs.clear();
    if ((flags_ & kUvs) != 0) {
      mesh_.uvs.resize(2 * count);
      const std::uint32_t sides[] = {mesh_.image.width, mesh_.image.height};
      bool isInside = true;
      for (std::size_t axis = 0; axis < 2; ++axis) {
        const float scale = 0.5F / static_cast<float>(sides[axis]);
        readPlane<2>(count, [&](std::size_t at, std::uint32_t value) {
          mesh_.uvs[2 * at + axis] = scale * static_cast<float>(value);
          isInside = isInside && value <= 2 * sides[axis];
        });
      }
      if (!isInside) return Status::damaged("a texture coordinate beyond the image, expected 0 to 1");
    }
    const std::uint16_t region = readU16(head_ + 24);
    mesh_.regions.clear();
    if ((flags_ & kRegions) != 0) {
      readCodes(mesh_.regions);
    } else if (region != kNoRegion) {
      mesh_.regions.resize(count, region);
    }
    mesh_.attributes.resize(attributes);
    for (std::size_t at = 0; at < attributes; ++at) {
      mesh_.attributes[at].clear();
      if (at < 32 && ((mask_ >> at) & 1) != 0) readCodes(mesh_.attributes[at]);
    }
    return {};
  }

  void readCodes(std::vector<std::uint16_t>& out) {
    out.resize(mesh_.vertexCount);
    readPlane<2>(out.size(), [&out](std::size_t at, std::uint32_t value) { out[at] = static_cast<std::uint16_t>(value); });
  }

  /// Undo the octahedral form: x and z are there.
  void unfoldNormals() {
    for (std::size_t at = 0; at < mesh_.normals.size(); at += 3) {
      std::int8_t* normal = &mesh_.normals[at];
      const int y = 127 - std::abs(normal[0]) - std::abs(normal[2]);
      for (int axis = 0; y < 0 && axis < 3; axis += 2) {
        const int part = normal[axis];
        normal[axis] = static_cast<std::int8_t>(part > 0 ? std::max(part + y, 0) : std::min(part - y, 0));
      }
      normal[1] = static_cast<std::int8_t>(std::max(y, -127));
    }
  }

  SegmentDecoder& decoder_;
  SegmentMesh& mesh_;
  const std::uint8_t* head_ = nullptr;
  unsigned flags_ = 0;
  /// Bit k: the scene's k-th attribute.
  std::uint32_t mask_ = 0;
  /// Corners that are named: three of a strip's first face, one of every other.
  std::uint64_t corners_ = 0;
  const std::uint8_t* starts_ = nullptr;
  const std::uint8_t* lefts_ = nullptr;
  const std::uint8_t* news_ = nullptr;
  /// Where the next plane begins.
  const std::uint8_t* next_ = nullptr;
};

Status SegmentDecoder::decode(ByteSpan payload, std::size_t attributes, Kind kind, SegmentMesh& mesh) {
  return SegmentReading(*this, mesh).read(payload, attributes, kind);
}

const char* mediaTypeOf(ImageKind kind) {
  constexpr const char* kTypes[] = {"", "image/jpeg", "image/png", "image/webp", "image/ktx2"};
  return kTypes[static_cast<int>(kind)];
}

std::size_t SegmentImage::gpuBytes() const {
  if (kind == ImageKind::None) return 0;
  std::size_t total = 0;
  for (std::size_t w = width, h = height;; w = std::max<std::size_t>(w / 2, 1), h = std::max<std::size_t>(h / 2, 1)) {
    // Compressed forms keep blocks of 4 x 4 texels, also of smaller levels.
    total += texelBits == 32 ? w * h * 4 : ((w + 3) / 4) * ((h + 3) / 4) * 2 * texelBits;
    if (w <= 1 && h <= 1) return total;
  }
}

std::size_t SegmentMesh::capacityBytes() const {
  std::size_t bytes = 4 * (positions.capacity() + uvs.capacity() + indices.capacity()) + normals.capacity() +
      colours.capacity() + 2 * regions.capacity();
  for (const auto& codes : attributes) bytes += 2 * codes.capacity();
  return bytes;
}

Inflater::~Inflater() {
  if (stream_ != nullptr) inflateEnd(stream_);
  delete stream_;
}

bool Inflater::inflateGzip(ByteSpan packed, std::size_t size, Bytes& out) {
  if (stream_ == nullptr) {
    stream_ = new z_stream();
    // + 16: gzip, and nothing else.
    if (inflateInit2(stream_, MAX_WBITS + 16) != Z_OK) return false;
  }
  if (inflateReset(stream_) != Z_OK) return false;
  out.resize(size);
  std::uint8_t nothing = 0;  // zlib wants an address, also for no bytes.
  stream_->next_in = const_cast<Bytef*>(packed.data);
  stream_->avail_in = static_cast<uInt>(packed.size);
  stream_->next_out = size > 0 ? out.data() : &nothing;
  stream_->avail_out = static_cast<uInt>(size);
  return inflate(stream_, Z_FINISH) == Z_STREAM_END && stream_->avail_in == 0 && stream_->avail_out == 0;
}

}  // namespace terraport
