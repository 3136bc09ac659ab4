// What the engine's renderer is given of a mesh, made where it is decoded: never in a frame.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "Godot.h"
#include "GroundMesh.h"
#include "Terraport/SceneFiles.h"
#include "Terraport/SegmentMesh.h"

namespace terraport::godot {

/// Arrays of vertices as the engine takes them, in the scene frame, which is the engine's own: right-handed, metres, y up.
struct VertexArrays {
  Variant positions;
  Variant normals;
  /// sRGB; nil where there are none.
  Variant colours;
  /// Nil without an image.
  Variant uvs;
  /// Region and value of the chosen attribute; -1 for no region, kNoValue for no value. Nil where there is neither.
  Variant facts;
};

/// Stands for "no value" among an attribute's values.
constexpr float kNoValue = -1.0e30F;

/// What a segment brings to `upload`, beside the mesh that it belongs to.
class SegmentData final : public EngineData {
 public:
  VertexArrays vertices;
  Variant indices;
  /// An engine's Image with mips; nil where there is none, or it could not be read.
  Variant image;
  GroundMesh ground;

  /// On a decoding thread. `attribute` is the name of the one whose values are drawn; empty for none.
  void build(const SegmentMesh& mesh, ByteSpan payload, const std::string& attribute);
  /// Give back what was not uploaded.
  void clear();
};

/// One block of the base: consecutive faces, and the vertices that they use.
struct BaseBlock {
  VertexArrays vertices;
  std::vector<Float3> positions;
  /// Corners, three a face, in the scene's order.
  std::vector<std::uint32_t> corners;
};

/// The base as it is drawn. Made once for a version, on the loading thread.
struct BaseParts {
  std::uint32_t blockFaces = 1;
  std::vector<BaseBlock> blocks;
  Variant image;
  /// The image is of the points' colours, not of photographs: it is shaded as they are.
  bool isOfPoints = false;
};

std::shared_ptr<BaseParts> makeBaseParts(const SceneFiles& files, std::uint32_t blockFaces, const std::string& attribute);

/// Corners in the engine's order, whose front is where they run clockwise. `isHidden` may be null; `first` is the face of
/// the first corner.
Variant indexArray(const std::vector<std::uint32_t>& corners, const std::uint8_t* isHidden);

/// All arrays of a surface, as mesh_add_surface_from_arrays takes them.
Variant surfaceArrays(const VertexArrays& vertices, const Variant& indices);

/// Decode an image file of a payload: JPEG, PNG or WebP. Nil where it is none of these, or damaged.
Variant decodeImage(const PayloadImage& image, ByteSpan payload);

}  // namespace terraport::godot
