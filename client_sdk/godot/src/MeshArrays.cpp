#include "MeshArrays.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <unordered_map>

namespace terraport::godot {

namespace {

Method kLoadJpeg{"Image", "load_jpg_from_buffer"};
Method kLoadPng{"Image", "load_png_from_buffer"};
Method kLoadWebp{"Image", "load_webp_from_buffer"};
Method kImageWidth{"Image", "get_width"};
Method kImageHeight{"Image", "get_height"};
Method kGenerateMipmaps{"Image", "generate_mipmaps"};

/// Columns of a mesh as floats, before some of its vertices are taken.
struct Columns {
  std::vector<Float3> positions;
  std::vector<Float3> normals;
  std::vector<Float4> colours;
  std::vector<Float2> uvs;
  std::vector<Float2> facts;
};

Columns columnsOf(const SegmentMesh& mesh, const std::string& attribute) {
  const std::size_t count = mesh.vertexCount;
  Columns columns;
  columns.positions.resize(count);
  mesh.writePositions(&columns.positions.data()->x);
  columns.normals.resize(count);
  mesh.writeNormals(&columns.normals.data()->x);
  if (mesh.hasColours) {
    columns.colours.resize(count);
    for (std::size_t at = 0; at < count; ++at) {
      const std::uint8_t* rgba = &mesh.colours[4 * at];
      columns.colours[at] = {float(rgba[0]) / 255.0F, float(rgba[1]) / 255.0F, float(rgba[2]) / 255.0F, 1.0F};
    }
  }
  if (mesh.hasUvs) {
    columns.uvs.resize(count);
    mesh.writeUvs(&columns.uvs.data()->x);
  }
  std::size_t column = 0;
  while (column < mesh.attributeCount && mesh.attributes[column].name != attribute) ++column;
  const bool hasValues = column < mesh.attributeCount;
  if (mesh.hasRegionIds || hasValues) {
    std::vector<float> values(hasValues ? count : 0);
    if (hasValues) mesh.writeAttribute(column, values.data());
    columns.facts.resize(count);
    for (std::size_t at = 0; at < count; ++at) {
      const float region = mesh.hasRegionIds ? float(mesh.regionIds[at]) : -1.0F;
      columns.facts[at] = {region, hasValues && std::isfinite(values[at]) ? values[at] : kNoValue};
    }
  }
  return columns;
}

/// Entries of a column at `chosen`; nil where the column is empty.
template <typename Entry>
Variant pick(const std::vector<Entry>& column, const std::vector<std::uint32_t>& chosen) {
  if (column.empty()) return Variant();
  return arrayOf<Entry>(chosen.size(), [&](Entry* out) {
    for (std::size_t at = 0; at < chosen.size(); ++at) out[at] = column[chosen[at]];
  });
}

template <typename Entry>
Variant all(const std::vector<Entry>& column) {
  if (column.empty()) return Variant();
  return arrayOf<Entry>(
      column.size(), [&](Entry* out) { std::memcpy(static_cast<void*>(out), column.data(), column.size() * sizeof(Entry)); });
}

}  // namespace

void SegmentData::build(const SegmentMesh& mesh, ByteSpan payload, const std::string& attribute) {
  Columns columns = columnsOf(mesh, attribute);
  const std::vector<std::uint32_t> corners(mesh.indices.begin(), mesh.indices.end());
  vertices = {all(columns.positions), all(columns.normals), all(columns.colours), all(columns.uvs), all(columns.facts)};
  indices = indexArray(corners, nullptr);
  image = decodeImage(mesh.image, payload);
  ground = GroundMesh(std::move(columns.positions), corners);
}

void SegmentData::clear() {
  vertices = VertexArrays();
  indices = Variant();
  image = Variant();
  ground = GroundMesh();
}

std::shared_ptr<BaseParts> makeBaseParts(const SceneFiles& files, std::uint32_t blockFaces, const std::string& attribute) {
  const SegmentMesh& base = files.base;
  auto parts = std::make_shared<BaseParts>();
  parts->blockFaces = blockFaces;
  parts->image = decodeImage(base.image, viewOf(*files.basePayload));
  parts->isOfPoints = files.manifest.hasColour;
  const Columns columns = columnsOf(base, attribute);
  for (std::uint32_t first = 0; first < base.faceCount; first += blockFaces) {
    const std::uint32_t end = std::min(first + blockFaces, base.faceCount);
    BaseBlock block;
    std::vector<std::uint32_t> chosen;
    std::unordered_map<std::uint32_t, std::uint32_t> placeOf;
    for (std::size_t corner = 3 * std::size_t(first); corner < 3 * std::size_t(end); ++corner) {
      const std::uint32_t vertex = base.indices[corner];
      const auto [entry, isNew] = placeOf.try_emplace(vertex, static_cast<std::uint32_t>(chosen.size()));
      if (isNew) chosen.push_back(vertex);
      block.corners.push_back(entry->second);
    }
    for (const std::uint32_t vertex : chosen) block.positions.push_back(columns.positions[vertex]);
    block.vertices = {pick(columns.positions, chosen), pick(columns.normals, chosen), pick(columns.colours, chosen),
        pick(columns.uvs, chosen), pick(columns.facts, chosen)};
    parts->blocks.push_back(std::move(block));
  }
  return parts;
}

Variant indexArray(const std::vector<std::uint32_t>& corners, const std::uint8_t* isHidden) {
  const std::size_t faces = corners.size() / 3;
  std::size_t shown = faces;
  if (isHidden != nullptr) shown -= static_cast<std::size_t>(std::count(isHidden, isHidden + faces, 1));
  if (shown == 0) return Variant();
  return arrayOf<std::int32_t>(3 * shown, [&](std::int32_t* out) {
    for (std::size_t face = 0; face < faces; ++face) {
      if (isHidden != nullptr && isHidden[face] != 0) continue;
      // The scene's fronts run counter-clockwise, the engine's clockwise.
      *out++ = static_cast<std::int32_t>(corners[3 * face]);
      *out++ = static_cast<std::int32_t>(corners[3 * face + 2]);
      *out++ = static_cast<std::int32_t>(corners[3 * face + 1]);
    }
  });
}

Variant surfaceArrays(const VertexArrays& vertices, const Variant& indices) {
  List arrays;
  arrays.add(vertices.positions);
  arrays.add(vertices.normals);
  arrays.add(Variant());  // tangents
  arrays.add(vertices.colours);
  arrays.add(vertices.uvs);
  arrays.add(vertices.facts);
  arrays.add(Variant());  // bones
  arrays.add(Variant());  // weights
  arrays.add(indices);
  return arrays.variant();
}

Variant decodeImage(const PayloadImage& image, ByteSpan payload) {
  const Method* load = image.type == ImageType::Jpeg ? &kLoadJpeg
      : image.type == ImageType::Png                 ? &kLoadPng
      : image.type == ImageType::Webp                ? &kLoadWebp
                                                     : nullptr;
  if (load == nullptr || image.offset + image.bytes > payload.size) return Variant();
  const Variant file = arrayOf<std::uint8_t>(
      image.bytes, [&](std::uint8_t* out) { std::memcpy(out, payload.data + image.offset, image.bytes); });
  Variant decoded = make("Image");
  if ((*load)(decoded, file).toInt() != 0) return Variant();
  // The sides were bounded by what the header said: an image that decodes to others lied.
  if (kImageWidth(decoded).toInt() != image.width || kImageHeight(decoded).toInt() != image.height) return Variant();
  (void)kGenerateMipmaps(decoded);
  return decoded;
}

}  // namespace terraport::godot
