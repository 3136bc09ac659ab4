#include "Terraport/SegmentMesh.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

namespace terraport {
namespace {

constexpr std::uint16_t kNullCode = 65535;

/// The nearest sRGB level (IEC 61966-2-1) of each of the 65536 linear codes.
struct SrgbTable {
  std::uint8_t levels[65536];

  SrgbTable() {
    std::size_t code = 0;
    for (int level = 0; level < 255; ++level) {
      const double value = (level + 0.5) / 255.0;
      const double linear = value <= 0.04045 ? value / 12.92 : std::pow((value + 0.055) / 1.055, 2.4);
      const double border = linear * 65535.0;
      for (; static_cast<double>(code) < border; ++code) {
        levels[code] = static_cast<std::uint8_t>(level);
      }
    }
    for (; code < sizeof levels; ++code) {
      levels[code] = 255;
    }
  }
};

const SrgbTable& srgbTable() {
  static const SrgbTable table;
  return table;
}

}  // namespace

const char* mediaTypeOf(ImageType type) {
  switch (type) {
    case ImageType::Jpeg:
      return "image/jpeg";
    case ImageType::Png:
      return "image/png";
    case ImageType::Webp:
      return "image/webp";
    case ImageType::Ktx2:
      return "image/ktx2";
    case ImageType::None:
      break;
  }
  return "";
}

std::size_t PayloadImage::gpuBytes() const {
  if (type == ImageType::None) return 0;
  std::size_t total = 0;
  for (std::size_t w = width, h = height;; w = std::max<std::size_t>(w / 2, 1), h = std::max<std::size_t>(h / 2, 1)) {
    // Compressed forms keep blocks of 4 x 4 texels, also of smaller levels.
    total += texelBits == 32 ? w * h * 4 : ((w + 3) / 4) * ((h + 3) / 4) * 2 * texelBits;
    if (w <= 1 && h <= 1) return total;
  }
}

std::uint8_t srgbOfLinear16(std::uint16_t code) {
  return srgbTable().levels[code];
}

void SegmentMesh::clear() {
  segment = -1;
  vertexCount = 0;
  faceCount = 0;
  positionForm = VertexForm::Codes;
  std::fill(translation, translation + 3, 0.0);
  stepM = 1.0;
  positionCodes.clear();
  positions.clear();
  normalCodes.clear();
  hasColours = false;
  colours.clear();
  hasUvs = false;
  uvScale[0] = uvScale[1] = 1.0F;
  uvsNormalised = false;
  uvCodes.clear();
  hasRegionIds = false;
  regionIds.clear();
  attributeCount = 0;
  for (AttributeColumn& column : attributes) {
    column.codes.clear();
  }
  indices.clear();
  maxIndex = 0;
  image = PayloadImage();
  bounds = Box();
}

std::size_t SegmentMesh::capacityBytes() const {
  std::size_t bytes = positionCodes.capacityBytes() + positions.capacityBytes() + normalCodes.capacityBytes() +
      colours.capacityBytes() + uvCodes.capacityBytes() + regionIds.capacityBytes() + indices.capacityBytes();
  for (const AttributeColumn& column : attributes) {
    bytes += column.codes.capacityBytes();
  }
  return bytes;
}

void SegmentMesh::writePositions(float* out) const {
  if (positionForm == VertexForm::Floats) {
    std::memcpy(out, positions.data(), positions.size() * sizeof(float));
    return;
  }
  const std::uint16_t* code = positionCodes.data();
  for (std::uint32_t vertex = 0; vertex < vertexCount; ++vertex, code += 4, out += 3) {
    for (int axis = 0; axis < 3; ++axis) {
      out[axis] = static_cast<float>(translation[axis] + stepM * code[axis]);
    }
  }
}

void SegmentMesh::writeNormals(float* out) const {
  const std::int8_t* code = normalCodes.data();
  for (std::uint32_t vertex = 0; vertex < vertexCount; ++vertex, code += 4, out += 3) {
    float length = 0.0F;
    for (int axis = 0; axis < 3; ++axis) {
      out[axis] = std::max(static_cast<float>(code[axis]) / 127.0F, -1.0F);
      length += out[axis] * out[axis];
    }
    length = std::sqrt(length);
    for (int axis = 0; axis < 3; ++axis) {
      out[axis] /= length;
    }
  }
}

void SegmentMesh::writeUvs(float* out) const {
  for (std::size_t at = 0; at < uvCodes.size(); ++at) {
    const float code = uvCodes[at];
    out[at] = uvsNormalised ? code / 65535.0F : code * uvScale[at % 2];
  }
}

void SegmentMesh::writeAttribute(std::size_t column, float* out) const {
  const AttributeColumn& from = attributes[column];
  for (std::size_t at = 0; at < from.codes.size(); ++at) {
    const std::uint16_t code = from.codes[at];
    out[at] = code == kNullCode ? std::numeric_limits<float>::quiet_NaN() : static_cast<float>(from.offset + from.step * code);
  }
}

}  // namespace terraport
