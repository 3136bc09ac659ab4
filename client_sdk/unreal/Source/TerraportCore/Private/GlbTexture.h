// The texture of a GLB: image and texture coordinates' scale, found along the chain from the material (glTF 2.0, sections 3.8
// and 3.9; EXT_texture_webp, KHR_texture_basisu, KHR_texture_transform).
#pragma once

#include "Terraport/Json.h"
#include "Terraport/SegmentMesh.h"
#include "Terraport/Status.h"

namespace terraport {

/// What a material says of its texture.
struct GlbTexture {
  /// None where the material has no texture; then nothing else counts.
  ImageType type = ImageType::None;
  /// Number of the image's bufferView.
  JsonValue view;
  bool hasScale = false;
  /// What texture coordinates are multiplied with; powers of two up to 1.
  float uvScale[2] = {1.0F, 1.0F};
};

/// Find the texture of a primitive's material. A failure where the chain is broken, or outside the profile.
Status findGlbTexture(JsonValue document, JsonValue primitive, GlbTexture& texture);

}  // namespace terraport
