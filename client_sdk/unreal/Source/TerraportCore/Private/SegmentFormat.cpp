#include "SegmentFormat.h"

#include <algorithm>
#include <bitset>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <initializer_list>
#include <string>

#include "ImageHeader.h"
#include "LittleEndian.h"
#include "MeshChecks.h"

namespace terraport {
namespace {

constexpr std::size_t kOuterBytes = 12;
constexpr std::size_t kHeadBytes = 40;
/// Header and trailer of a gzip stream.
constexpr std::size_t kGzipBytes = 18;
constexpr std::size_t kMaxStreamBytes = std::size_t{1} << 28;
/// DEFLATE makes at most 1032 bytes out of one.
constexpr std::size_t kMaxExpansion = 1032;
constexpr unsigned kColours = 1, kUvs = 2, kRegions = 4;
constexpr std::uint16_t kNoRegion = 65535;
constexpr ImageType kImages[] = {ImageType::None, ImageType::Jpeg, ImageType::Png, ImageType::Webp, ImageType::Ktx2};

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

/// Sum up `count` differences of `width` bytes in zigzag form; value n goes to out[n * stride].
template <unsigned width, typename T>
void sumDifferences(const std::uint8_t* plane, std::size_t count, T* out, std::size_t stride) {
  std::uint32_t value = 0;
  for (std::size_t at = 0; at < count; ++at) {
    std::uint32_t code = 0;
    for (unsigned byte = 0; byte < width; ++byte) code |= std::uint32_t{plane[byte * count + at]} << (8 * byte);
    value += (code >> 1) ^ (0 - (code & 1));
    out[at * stride] = static_cast<T>(width == 2 ? value & 0xFFFF : value);
  }
}

/// Undo the octahedral form of each vertex's first and third code. The vector that comes out is not of length 1.
void unfoldNormals(std::int8_t* normal, std::size_t count) {
  for (; count > 0; --count, normal += 4) {
    const int y = 127 - std::abs(normal[0]) - std::abs(normal[2]);
    for (int axis = 0; y < 0 && axis < 3; axis += 2) {
      const int part = normal[axis];
      normal[axis] = static_cast<std::int8_t>(part > 0 ? std::max(part + y, 0) : std::min(part - y, 0));
    }
    normal[1] = static_cast<std::int8_t>(std::max(y, -127));
    normal[3] = 0;
  }
}

}  // namespace

/// One segment being read.
class SegmentReading {
 public:
  SegmentReading(SegmentDecoder& decoder, SegmentMesh& mesh) : decoder_(decoder), mesh_(mesh) {}

  Status read(ByteSpan payload, const std::vector<AttributeInfo>& attributes) {
    if (payload.size < kOuterBytes || std::memcmp(payload.data, "TSG2", 4) != 0) {
      return Status::damaged("segment of " + std::to_string(payload.size) + " bytes, expected TSG2 and at least 8 more", 0);
    }
    const std::uint64_t packedBytes = readU32(payload.data + 4);
    if (payload.size != kOuterBytes + packedBytes + readU32(payload.data + 8)) {
      return Status::damaged("segment of " + std::to_string(payload.size) + " bytes, expected as its head says", 4);
    }
    const auto imageOffset = static_cast<std::size_t>(kOuterBytes + packedBytes);
    TERRAPORT_RETURN_IF_ERROR(decoder_.inflateStream({payload.data + kOuterBytes, imageOffset - kOuterBytes}));
    head_ = decoder_.stream_.data();
    TERRAPORT_RETURN_IF_ERROR(readHead(attributes.size()));
    TERRAPORT_RETURN_IF_ERROR(readImage(payload, imageOffset));
    TERRAPORT_RETURN_IF_ERROR(findPlanes());
    TERRAPORT_RETURN_IF_ERROR(readFaces());
    return readVertices(attributes);
  }

 private:
  Status readHead(std::size_t attributes) {
    mesh_.vertexCount = readU32(head_);
    mesh_.faceCount = readU32(head_ + 4);
    mesh_.stepM = std::ldexp(1.0, static_cast<std::int8_t>(head_[20]));
    for (int axis = 0; axis < 3; ++axis) {
      mesh_.translation[axis] = mesh_.stepM * static_cast<std::int32_t>(readU32(head_ + 8 + 4 * axis));
    }
    flags_ = head_[21];
    mask_ = readU32(head_ + 32);
    if (mesh_.vertexCount == 0 || mesh_.faceCount == 0 || flags_ > 7 || (flags_ & (kColours | kUvs)) == (kColours | kUvs) ||
        (attributes < 32 && (mask_ >> attributes) != 0)) {
      return Status::damaged("segment with flags " + std::to_string(flags_) + " and attributes " + std::to_string(mask_) +
          ", expected flags that we know, attributes of the scene, and a face");
    }
    return {};
  }

  Status readImage(ByteSpan payload, std::size_t offset) {
    const ByteSpan file = {payload.data + offset, payload.size - offset};
    const unsigned kind = head_[22];
    mesh_.hasUvs = (flags_ & kUvs) != 0;
    if (kind > 4 || (kind != 0) != mesh_.hasUvs || (file.size != 0) != mesh_.hasUvs ||
        crc32(0, file.data, static_cast<uInt>(file.size)) != readU32(head_ + 36)) {
      return Status::damaged("an image that is damaged, missing or of an unknown kind", static_cast<std::int64_t>(offset));
    }
    if (!mesh_.hasUvs) return {};
    ImageHeader header;
    TERRAPORT_RETURN_IF_ERROR(readPayloadImage(file, false, header));
    if (header.type != kImages[kind] || header.width != readU16(head_ + 26) || header.height != readU16(head_ + 28)) {
      return Status::damaged("an image of another type or size than the segment says", static_cast<std::int64_t>(offset));
    }
    mesh_.image = {header.type, header.width, header.height, header.texelBits, offset, file.size};
    mesh_.uvScale[0] = 0.5F / static_cast<float>(header.width);
    mesh_.uvScale[1] = 0.5F / static_cast<float>(header.height);
    return {};
  }

  /// Find the planes of faces. Damaged where the stream does not have exactly the bytes of all planes: none is checked later.
  Status findPlanes() {
    const std::uint64_t size = decoder_.stream_.size();
    const std::uint64_t vertices = mesh_.vertexCount;
    const std::uint64_t faceBytes = bitPlaneBytes(mesh_.faceCount);
    starts_ = head_ + kHeadBytes;
    if (size < kHeadBytes + faceBytes) return Status::damaged("planes are cut off");
    corners_ = mesh_.faceCount + std::uint64_t{2} * countOnes(starts_, mesh_.faceCount);
    const std::uint64_t oldBytes = corners_ < vertices ? 0 : (vertices <= 65536 ? 2 : 4) * (corners_ - vertices);
    const std::uint64_t vertexBytes = 8 + ((flags_ & kColours) != 0 ? 3 : 0) + ((flags_ & kUvs) != 0 ? 4 : 0) +
        ((flags_ & kRegions) != 0 ? 2 : 0) + 2 * std::bitset<32>(mask_).count();
    const std::uint64_t all = kHeadBytes + 2 * faceBytes + bitPlaneBytes(corners_) + oldBytes + vertices * vertexBytes;
    if (size != all) {
      return Status::damaged("planes of " + std::to_string(size) + " bytes, expected " + std::to_string(all));
    }
    lefts_ = starts_ + faceBytes;
    news_ = lefts_ + faceBytes;
    next_ = news_ + bitPlaneBytes(corners_);
    if (!bitAt(starts_, 0) || countOnes(news_, static_cast<std::size_t>(corners_)) != vertices) {
      return Status::damaged("faces that begin no strip, or name other than " + std::to_string(vertices) + " vertices");
    }
    return {};
  }

  /// Read planes of `rows` differences of `width` bytes each; the k-th goes to column places[k] of `stride`.
  template <unsigned width, typename T>
  Status readPlanes(std::size_t rows, std::initializer_list<int> places, std::size_t stride, SegmentBuffer<T>& out) {
    if (!out.resize(rows * stride)) return Status::failed("out_of_memory", "no memory for a segment's arrays");
    for (const int place : places) {
      sumDifferences<width>(next_, rows, out.data() + place, stride);
      next_ += rows * width;
    }
    return {};
  }

  Status readFaces() {
    const auto oldCount = static_cast<std::size_t>(corners_ - mesh_.vertexCount);
    SegmentBuffer<std::uint32_t>& olds = decoder_.oldCorners_;
    TERRAPORT_RETURN_IF_ERROR(
        mesh_.vertexCount <= 65536 ? readPlanes<2>(oldCount, {0}, 1, olds) : readPlanes<4>(oldCount, {0}, 1, olds));
    if (!mesh_.indices.resize(3 * std::size_t{mesh_.faceCount})) return Status::failed("out_of_memory", "no memory for faces");
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
    mesh_.maxIndex = mesh_.vertexCount - 1;
    return isEarly ? Status::damaged("a face with a vertex that is not there yet") : Status();
  }

  Status readVertices(const std::vector<AttributeInfo>& attributes) {
    const std::size_t count = mesh_.vertexCount;
    TERRAPORT_RETURN_IF_ERROR(readPlanes<2>(count, {0, 1, 2}, 4, mesh_.positionCodes));
    TERRAPORT_RETURN_IF_ERROR(computeBounds(mesh_));
    const Box& box = mesh_.bounds;
    for (const float end : {box.minX, box.minY, box.minZ, box.maxX, box.maxY, box.maxZ}) {
      if (std::fabs(end) >= std::ldexp(mesh_.stepM, 24)) {
        return Status::damaged("a position 2^24 steps or more from the origin, expected less");
      }
    }
    TERRAPORT_RETURN_IF_ERROR(readPlanes<1>(count, {0, 2}, 4, mesh_.normalCodes));
    unfoldNormals(mesh_.normalCodes.data(), count);
    mesh_.hasColours = (flags_ & kColours) != 0;
    if (mesh_.hasColours) {
      TERRAPORT_RETURN_IF_ERROR(readPlanes<1>(count, {1, 0, 2}, 4, mesh_.colours));
      for (std::uint8_t* rgba = mesh_.colours.begin(); rgba != mesh_.colours.end(); rgba += 4) {
        rgba[0] = static_cast<std::uint8_t>(rgba[0] + rgba[1]);
        rgba[2] = static_cast<std::uint8_t>(rgba[2] + rgba[1]);
        rgba[3] = 255;
      }
    }
    if (mesh_.hasUvs) {
      TERRAPORT_RETURN_IF_ERROR(readPlanes<2>(count, {0, 1}, 2, mesh_.uvCodes));
      TERRAPORT_RETURN_IF_ERROR(checkUvs(mesh_));
    }
    const std::uint16_t region = readU16(head_ + 24);
    mesh_.hasRegionIds = (flags_ & kRegions) != 0 || region != kNoRegion;
    if ((flags_ & kRegions) != 0) {
      TERRAPORT_RETURN_IF_ERROR(readPlanes<2>(count, {0}, 1, mesh_.regionIds));
    } else if (mesh_.hasRegionIds) {
      TERRAPORT_RETURN_IF_ERROR(readPlanes<2>(count, {}, 1, mesh_.regionIds));
      std::fill(mesh_.regionIds.begin(), mesh_.regionIds.end(), region);
    }
    for (std::size_t bit = 0; bit < 32; ++bit) {
      if (((mask_ >> bit) & 1) == 0) continue;
      if (mesh_.attributeCount == mesh_.attributes.size()) mesh_.attributes.emplace_back();
      AttributeColumn& column = mesh_.attributes[mesh_.attributeCount];
      ++mesh_.attributeCount;
      column.name = attributes[bit].name;
      column.offset = attributes[bit].offset;
      column.step = attributes[bit].step;
      TERRAPORT_RETURN_IF_ERROR(readPlanes<2>(count, {0}, 1, column.codes));
    }
    return {};
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

SegmentDecoder::~SegmentDecoder() {
  if (isReady_) inflateEnd(&inflater_);
}

Status SegmentDecoder::inflateStream(ByteSpan packed) {
  // The last four bytes say how long the stream is; zlib compares that, and the checksum, with what it made.
  const std::size_t size = packed.size < kGzipBytes ? 0 : readU32(packed.data + packed.size - 4);
  if (size < kHeadBytes || size > kMaxStreamBytes || size / kMaxExpansion > packed.size) {
    return Status::damaged("planes of " + std::to_string(size) + " bytes, expected 40 to 2^28, and what can be", kOuterBytes);
  }
  isReady_ = isReady_ || inflateInit2(&inflater_, MAX_WBITS + 16) == Z_OK;  // + 16: gzip, and nothing else
  if (!isReady_ || inflateReset(&inflater_) != Z_OK || !stream_.resize(size)) {
    return Status::failed("out_of_memory", "no memory for a segment's planes");
  }
  inflater_.next_in = const_cast<Bytef*>(packed.data);
  inflater_.avail_in = static_cast<uInt>(packed.size);
  inflater_.next_out = stream_.data();
  inflater_.avail_out = static_cast<uInt>(size);
  if (inflate(&inflater_, Z_FINISH) != Z_STREAM_END || inflater_.avail_in != 0 || inflater_.avail_out != 0) {
    return Status::damaged("planes are damaged, cut off or too long", kOuterBytes);
  }
  return {};
}

Status SegmentDecoder::decode(
    ByteSpan payload, const std::vector<AttributeInfo>& attributes, std::int64_t segment, SegmentMesh& mesh) {
  mesh.clear();
  mesh.segment = segment;
  Status status = SegmentReading(*this, mesh).read(payload, attributes);
  if (!status.isOk()) mesh.clear();
  return status;
}

}  // namespace terraport
