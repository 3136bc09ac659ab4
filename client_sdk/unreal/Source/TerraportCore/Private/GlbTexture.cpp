#include "GlbTexture.h"

#include <cmath>
#include <string>
#include <string_view>

#include "JsonExpect.h"

namespace terraport {
namespace {

constexpr std::string_view kTransform = "KHR_texture_transform";
/// Sides up to 32768 texels.
constexpr double kLeastScale = 1.0 / 65536.0;

bool isScale(JsonValue value, float& out) {
  const auto number = value.number();
  int exponent = 0;
  if (!number || !(*number >= kLeastScale && *number <= 1.0) || std::frexp(*number, &exponent) != 0.5) {
    return false;
  }
  out = static_cast<float>(*number);
  return true;
}

Status findImage(JsonValue document, JsonValue textureInfo, GlbTexture& texture) {
  JsonValue chosen;
  const JsonValue textures = document.member("textures");
  TERRAPORT_RETURN_IF_ERROR(expectList(textures, "textures"));
  TERRAPORT_RETURN_IF_ERROR(pickMap(textures, textureInfo.member("index"), "texture", chosen));
  const JsonValue extensions = chosen.member("extensions");
  TERRAPORT_RETURN_IF_ERROR(expectMapOrAbsent(extensions, "extensions of texture"));
  const JsonValue webp = extensions.member("EXT_texture_webp");
  const JsonValue ktx2 = extensions.member("KHR_texture_basisu");
  JsonValue source = chosen.member("source");
  for (const JsonValue extension : {webp, ktx2}) {
    if (extension.exists()) {
      TERRAPORT_RETURN_IF_ERROR(expectMap(extension, "extension of texture"));
      source = extension.member("source");
    }
  }
  const JsonValue images = document.member("images");
  TERRAPORT_RETURN_IF_ERROR(expectList(images, "images"));
  JsonValue image;
  TERRAPORT_RETURN_IF_ERROR(pickMap(images, source, "image", image));
  const std::string_view mediaType = image.member("mimeType").text().value_or("");
  for (const ImageType type : {ImageType::Jpeg, ImageType::Png, ImageType::Webp, ImageType::Ktx2}) {
    const bool isAllowed = ktx2.exists() ? type == ImageType::Ktx2
        : webp.exists()                  ? type == ImageType::Webp
                                         : type == ImageType::Jpeg || type == ImageType::Png;
    if (isAllowed && mediaType == mediaTypeOf(type)) {
      texture.type = type;
      texture.view = image.member("bufferView");
      return {};
    }
  }
  return Status::damaged("image of type " + shortly(image.member("mimeType")) +
      ", expected image/jpeg or image/png, or that of the texture's extension");
}

Status findScale(JsonValue textureInfo, GlbTexture& texture) {
  const JsonValue extensions = textureInfo.member("extensions");
  TERRAPORT_RETURN_IF_ERROR(expectMapOrAbsent(extensions, "extensions of baseColorTexture"));
  if (extensions.size() == 0) {
    return {};
  }
  const JsonValue transform = extensions.member(kTransform);
  TERRAPORT_RETURN_IF_ERROR(expectMap(transform, kTransform));
  const JsonValue scale = transform.member("scale");
  TERRAPORT_RETURN_IF_ERROR(expectList(scale, "scale of KHR_texture_transform"));
  bool isRight = transform.size() == 1 && scale.size() == 2;
  int at = 0;
  for (const JsonValue side : scale.items()) {
    isRight = isRight && isScale(side, texture.uvScale[at]);
    ++at;
  }
  if (!isRight) {
    return Status::damaged("KHR_texture_transform is no scale of two powers of two up to 1 alone");
  }
  texture.hasScale = true;
  return {};
}

}  // namespace

Status findGlbTexture(JsonValue document, JsonValue primitive, GlbTexture& texture) {
  texture = GlbTexture();
  const JsonValue number = primitive.member("material");
  if (!number.exists()) {
    return {};
  }
  JsonValue material;
  const JsonValue materials = document.member("materials");
  TERRAPORT_RETURN_IF_ERROR(expectList(materials, "materials"));
  TERRAPORT_RETURN_IF_ERROR(pickMap(materials, number, "material", material));
  const JsonValue surface = material.member("pbrMetallicRoughness");
  TERRAPORT_RETURN_IF_ERROR(expectMapOrAbsent(surface, "pbrMetallicRoughness"));
  const JsonValue textureInfo = surface.member("baseColorTexture");
  if (!textureInfo.exists()) {
    return {};
  }
  TERRAPORT_RETURN_IF_ERROR(expectMap(textureInfo, "baseColorTexture"));
  std::uint64_t set = 0;
  TERRAPORT_RETURN_IF_ERROR(expectWholeOr(textureInfo.member("texCoord"), "texCoord", 0, 0, set));
  if (set != 0) {
    return Status::damaged("baseColorTexture has another set, expected set 0");
  }
  TERRAPORT_RETURN_IF_ERROR(findImage(document, textureInfo, texture));
  return findScale(textureInfo, texture);
}

}  // namespace terraport
