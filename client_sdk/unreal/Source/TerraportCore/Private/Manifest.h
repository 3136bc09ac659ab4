// scene.json as a server gives it, checked for what a client uses (scene format, section 4); regions.json and labels.json
// (section 11).
#pragma once

#include <cstdint>
#include <string>
#include <unordered_map>
#include <vector>

#include "Terraport/Json.h"
#include "Terraport/SceneFiles.h"
#include "Terraport/Status.h"

namespace terraport {

/// Of regions.json (scene format, section 12).
constexpr std::size_t kMaxRegionsBytes = std::size_t{1} << 28;

/// A file of a version.
struct FileFacts {
  std::uint64_t bytes = 0;
  std::uint64_t xxh3 = 0;
};

/// A manifest, and what must come with it.
struct CheckedManifest {
  SceneManifest manifest;
  FileFacts baseGlb;
  FileFacts baseCover;
  FileFacts regionsJson;

  std::uint64_t totalBytes() const { return baseGlb.bytes + baseCover.bytes + regionsJson.bytes; }
};

/// Check a manifest; keys that are not known are skipped. `id` is the scene's of the URL. Codes: `unsupported_version` for
/// another major version; `damaged` for another format, or where a needed key is missing or not what it should be.
Status readManifest(ByteSpan json, const std::string& id, CheckedManifest& out);

/// A label by stable id.
using RegionLabels = std::unordered_map<std::uint32_t, std::string>;

/// Read labels.json. A file that is damaged gives no label at all: a name must never take the ground away.
RegionLabels readLabels(ByteSpan json);

/// Read regions.json. Everything but the order is informative: a fact that is missing, or not what it should be, is absent, and
/// unions end with the first that is not as it should be.
Status readRegions(ByteSpan json, const RegionLabels& labels, std::vector<RegionFacts>& out, std::vector<RegionUnion>& unions);

/// JSON text of a file.
inline std::string_view textOf(ByteSpan bytes) {
  return {reinterpret_cast<const char*>(bytes.data), bytes.size};
}

}  // namespace terraport
