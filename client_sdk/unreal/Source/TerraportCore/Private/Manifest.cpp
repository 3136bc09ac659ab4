#include "Manifest.h"

#include <cmath>
#include <utility>

#include "JsonExpect.h"

namespace terraport {
namespace {

/// Scene format, section 12.
constexpr std::uint64_t kMaxBaseBytes = std::uint64_t{1} << 30;
constexpr std::uint64_t kMaxCoverBytes = std::uint64_t{1} << 26;
/// A bound for arithmetic: faces are counted in 32 bits.
constexpr std::uint64_t kMaxCount = (std::uint64_t{1} << 31) - 1;
constexpr std::uint32_t kMaxSceneAttributes = 32;

bool isDigest(std::string_view text, std::size_t digits) {
  if (text.size() != digits) {
    return false;
  }
  for (const char letter : text) {
    if (!((letter >= '0' && letter <= '9') || (letter >= 'a' && letter <= 'f'))) {
      return false;
    }
  }
  return true;
}

Status expectText(JsonValue value, std::string_view label, std::string& out) {
  const auto text = value.text();
  if (!text || text->empty()) {
    return Status::damaged(std::string(label) + " is " + shortly(value) + ", expected text");
  }
  out.assign(text->data(), text->size());
  return {};
}

Status expectPoint(JsonValue value, std::string_view label, Vec3& out) {
  double numbers[3] = {0.0, 0.0, 0.0};
  TERRAPORT_RETURN_IF_ERROR(expectTriple(value, label, numbers));
  out = {numbers[0], numbers[1], numbers[2]};
  return {};
}

Status expectFormat(JsonValue json) {
  if (json.member("format").text().value_or("") != "terraport-scene") {
    return Status::damaged(
        "got format " + shortly(json.member("format")) + ", expected \"terraport-scene\"; is this a terraport server?");
  }
  const std::string_view version = json.member("format_version").text().value_or("");
  if (version.substr(0, version.find('.')) != "1") {
    return Status::failed("unsupported_version",
        "got scene format " + shortly(json.member("format_version")) + ", expected 1.x; a newer client is needed");
  }
  return {};
}

Status readCrs(JsonValue value, SceneManifest& manifest) {
  if (value.exists() && value.isNothing()) {
    return {};
  }
  TERRAPORT_RETURN_IF_ERROR(expectMap(value, "crs"));
  SceneCrs crs;
  TERRAPORT_RETURN_IF_ERROR(expectText(value.member("name"), "crs.name", crs.name));
  if (!value.member("epsg").isNothing()) {
    std::uint64_t epsg = 0;
    TERRAPORT_RETURN_IF_ERROR(expectWhole(value.member("epsg"), "crs.epsg", 0, epsg));
    crs.epsg = static_cast<std::uint32_t>(epsg);
  }
  manifest.crs = std::move(crs);
  return {};
}

Status readAttribute(JsonValue value, SceneManifest& manifest) {
  TERRAPORT_RETURN_IF_ERROR(expectMap(value, "attribute"));
  AttributeInfo info;
  TERRAPORT_RETURN_IF_ERROR(expectText(value.member("name"), "name of an attribute", info.name));
  TERRAPORT_RETURN_IF_ERROR(expectScale(value, info.offset, info.step));
  const std::pair<const char*, std::optional<double>*> ends[] = {{"min", &info.min}, {"max", &info.max}};
  for (const auto& [key, out] : ends) {
    const JsonValue end = value.member(key);
    if (!end.exists() || !end.isNothing()) {
      double number = 0.0;
      TERRAPORT_RETURN_IF_ERROR(expectNumber(end, key, number));
      *out = number;
    }
  }
  manifest.attributes.push_back(std::move(info));
  return {};
}

Status readTextures(JsonValue value, SceneManifest& manifest) {
  if (value.isNothing()) {
    return {};
  }
  TERRAPORT_RETURN_IF_ERROR(expectMap(value, "textures"));
  const JsonValue types = value.member("media_types");
  TERRAPORT_RETURN_IF_ERROR(expectList(types, "textures.media_types"));
  for (const JsonValue type : types.items()) {
    for (const ImageType supported : {ImageType::Jpeg, ImageType::Png, ImageType::Webp, ImageType::Ktx2}) {
      if (type.text().value_or("") == mediaTypeOf(supported) && manifest.imageTypes.size() < 4) {
        manifest.imageTypes.emplace_back(mediaTypeOf(supported));
      }
    }
  }
  manifest.hasTextures = !manifest.imageTypes.empty();
  return {};
}

Status readFile(JsonValue files, const char* key, std::uint64_t mostBytes, FileFacts& out) {
  const JsonValue file = files.member(key);
  TERRAPORT_RETURN_IF_ERROR(expectMap(file, key));
  TERRAPORT_RETURN_IF_ERROR(expectWhole(file.member("bytes"), key, 1, out.bytes));
  if (out.bytes > mostBytes) {
    return Status::damaged(
        std::string(key) + " of " + std::to_string(out.bytes) + " bytes, expected at most " + std::to_string(mostBytes));
  }
  const std::string_view hash = file.member("xxh3").text().value_or("");
  if (!isDigest(hash, 16)) {
    return Status::damaged(
        "xxh3 of " + std::string(key) + " is " + shortly(file.member("xxh3")) + ", expected 16 hexadecimal digits");
  }
  out.xxh3 = 0;
  for (const char digit : hash) {
    out.xxh3 = out.xxh3 * 16 + static_cast<std::uint64_t>(digit <= '9' ? digit - '0' : digit - 'a' + 10);
  }
  return {};
}

Status readCounts(JsonValue counts, SceneManifest& manifest) {
  TERRAPORT_RETURN_IF_ERROR(expectMap(counts, "counts"));
  std::uint64_t segments = 0;
  std::uint64_t baseFaces = 0;
  TERRAPORT_RETURN_IF_ERROR(expectWhole(counts.member("segments"), "counts.segments", 1, segments));
  TERRAPORT_RETURN_IF_ERROR(expectWhole(counts.member("base_faces"), "counts.base_faces", 1, baseFaces));
  // More than 2^31 detail faces are no mistake; nothing is reserved for them.
  const auto detailFaces = counts.member("detail_faces").integer();
  if (!detailFaces || *detailFaces < 1 || segments > kMaxCount || baseFaces > kMaxCount) {
    return Status::damaged("counts.detail_faces is " + shortly(counts.member("detail_faces")) + ", expected a whole number");
  }
  manifest.segmentCount = static_cast<std::uint32_t>(segments);
  manifest.baseFaces = static_cast<std::uint32_t>(baseFaces);
  manifest.detailFaces = static_cast<std::uint64_t>(*detailFaces);
  return {};
}

Status readLevels(JsonValue levels, SceneManifest& manifest) {
  if (levels.isNothing()) return {};
  std::uint64_t count = 0;
  TERRAPORT_RETURN_IF_ERROR(expectWhole(levels, "levels", 1, count));
  if (count > 2) return Status::damaged("levels is " + shortly(levels) + ", expected 1 or 2");
  manifest.levels = static_cast<std::uint32_t>(count);
  return {};
}

Status readFrame(JsonValue json, SceneManifest& manifest) {
  TERRAPORT_RETURN_IF_ERROR(expectTriple(json.member("origin"), "origin", manifest.origin));
  TERRAPORT_RETURN_IF_ERROR(expectNumber(json.member("step_m"), "step_m", manifest.stepM));
  int exponent = 0;
  if (!(manifest.stepM > 0.0) || std::frexp(manifest.stepM, &exponent) != 0.5) {
    return Status::damaged("step_m is " + shortly(json.member("step_m")) + ", expected a power of two");
  }
  const JsonValue bounds = json.member("bounds");
  TERRAPORT_RETURN_IF_ERROR(expectMap(bounds, "bounds"));
  TERRAPORT_RETURN_IF_ERROR(expectPoint(bounds.member("min"), "bounds.min", manifest.boundsMin));
  TERRAPORT_RETURN_IF_ERROR(expectPoint(bounds.member("max"), "bounds.max", manifest.boundsMax));
  const Vec3& low = manifest.boundsMin;
  const Vec3& high = manifest.boundsMax;
  if (low.x > high.x || low.y > high.y || low.z > high.z) {
    return Status::damaged("bounds.min is above bounds.max");
  }
  const JsonValue handOff = json.member("hand_off");
  TERRAPORT_RETURN_IF_ERROR(expectMap(handOff, "hand_off"));
  TERRAPORT_RETURN_IF_ERROR(expectNumber(handOff.member("deviation_m"), "hand_off.deviation_m", manifest.deviationM));
  if (manifest.deviationM < 0.0) {
    return Status::damaged("hand_off.deviation_m is below 0, expected a length");
  }
  return {};
}

Status readKeys(JsonValue json, CheckedManifest& out) {
  SceneManifest& manifest = out.manifest;
  const JsonValue encodings = json.member("encodings");
  TERRAPORT_RETURN_IF_ERROR(expectMap(encodings, "encodings"));
  TERRAPORT_RETURN_IF_ERROR(expectMap(encodings.member(kPayloadEncoding), "encodings.segment-2"));
  TERRAPORT_RETURN_IF_ERROR(expectText(json.member("name"), "name", manifest.name));
  TERRAPORT_RETURN_IF_ERROR(expectText(json.member("version"), "version", manifest.version));
  if (!isDigest(manifest.version, 32)) {
    return Status::damaged("version is " + shortly(json.member("version")) + ", expected 32 hexadecimal digits");
  }
  TERRAPORT_RETURN_IF_ERROR(readCrs(json.member("crs"), manifest));
  TERRAPORT_RETURN_IF_ERROR(readFrame(json, manifest));
  const JsonValue attributes = json.member("attributes");
  TERRAPORT_RETURN_IF_ERROR(expectList(attributes, "attributes"));
  if (attributes.size() > kMaxSceneAttributes) {
    return Status::damaged(std::to_string(attributes.size()) + " attributes, expected at most 32");
  }
  for (const JsonValue attribute : attributes.items()) {
    TERRAPORT_RETURN_IF_ERROR(readAttribute(attribute, manifest));
  }
  TERRAPORT_RETURN_IF_ERROR(readCounts(json.member("counts"), manifest));
  TERRAPORT_RETURN_IF_ERROR(readLevels(json.member("levels"), manifest));
  const auto hasColour = json.member("has_colour").boolean();
  if (!hasColour) {
    return Status::damaged("has_colour is " + shortly(json.member("has_colour")) + ", expected true or false");
  }
  manifest.hasColour = *hasColour;
  TERRAPORT_RETURN_IF_ERROR(readTextures(json.member("textures"), manifest));
  const JsonValue files = json.member("files");
  TERRAPORT_RETURN_IF_ERROR(expectMap(files, "files"));
  TERRAPORT_RETURN_IF_ERROR(readFile(files, "base.glb", kMaxBaseBytes, out.baseGlb));
  TERRAPORT_RETURN_IF_ERROR(readFile(files, "base.cover", kMaxCoverBytes, out.baseCover));
  return readFile(files, "regions.json", kMaxRegionsBytes, out.regionsJson);
}

}  // namespace

Status readManifest(ByteSpan json, const std::string& id, CheckedManifest& out) {
  out = CheckedManifest();
  out.manifest.id = id;
  JsonDocument document;
  JsonLimits limits;
  limits.maxBytes = std::size_t{4} << 20;
  const Status parsed = document.read(textOf(json), limits);
  if (!parsed.isOk() || !document.root().isMap()) {
    return Status::damaged("manifest of scene " + id + " is no JSON object; is this a terraport server?");
  }
  TERRAPORT_RETURN_IF_ERROR(expectFormat(document.root()));
  const Status status = readKeys(document.root(), out);
  if (!status.isOk()) {
    return Status::damaged("manifest of scene " + id + ": " + status.message() + "; the scene must be published anew");
  }
  return {};
}

}  // namespace terraport
