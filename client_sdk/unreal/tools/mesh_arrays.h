#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "Terraport/SegmentMesh.h"
#include "Terraport/Types.h"
#include "json_text.h"

namespace terraport::tools {

/// A decoded mesh in the form in which clients are compared (tests/engines/README.md, "Canonical arrays"): what the Python
/// SDK's arrays hold.
struct MeshArrays {
  MeshArrays(const SegmentMesh& mesh, ByteSpan payload);

  /// Write the digests of all arrays, and beside them the normals' own bytes to a folder, where one is given.
  void describe(JsonText& json, const std::string& folder, std::uint32_t segment) const;

  std::uint32_t vertexCount = 0;
  std::uint32_t faceCount = 0;
  /// Three per vertex, metres, scene frame.
  std::vector<float> positions;
  std::vector<std::uint32_t> indices;
  /// Three per vertex, unit.
  std::vector<float> normals;
  bool hasColours = false;
  /// Three per vertex, sRGB.
  std::vector<std::uint8_t> colours;
  bool hasRegionIds = false;
  std::vector<std::uint16_t> regionIds;
  bool hasUvs = false;
  /// Two per vertex.
  std::vector<float> uvs;
  /// Empty without a texture.
  std::vector<std::uint8_t> image;
  std::string mediaType;
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  std::vector<std::pair<std::string, std::vector<float>>> attributes;
};

/// XXH3-64 as 16 hexadecimal digits.
std::string digestOf(const void* data, std::size_t size);

}  // namespace terraport::tools
