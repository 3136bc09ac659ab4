// What is loaded once for a version of a scene.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "Terraport/Api.h"
#include "Terraport/SegmentMesh.h"
#include "Terraport/Types.h"

namespace terraport {

/// The survey's coordinate reference system.
struct SceneCrs {
  std::string name;
  std::optional<std::uint32_t> epsg;
};

struct AttributeInfo {
  std::string name;
  /// Of segments' codes: value = offset + step * code; 65535 means "no value".
  double offset = 0.0;
  double step = 1.0;
  /// Of the encoded values; absent when there is none.
  std::optional<double> min;
  std::optional<double> max;
};

/// What a client uses of scene.json.
struct SceneManifest {
  std::string id;
  std::string name;
  /// 32 hexadecimal digits.
  std::string version;
  std::optional<SceneCrs> crs;
  /// East, north, height of the frame's origin in the CRS, metres: E = E0 + x, N = N0 - z, H = H0 + y.
  double origin[3] = {0.0, 0.0, 0.0};
  /// A power of two.
  double stepM = 1.0;
  Vec3 boundsMin;
  Vec3 boundsMax;
  std::vector<AttributeInfo> attributes;
  /// The ids of full detail are below it, those of the coarser level from it on.
  std::uint32_t segmentCount = 0;
  /// Levels of every segment: 1, or 2 with a coarser one.
  std::uint32_t levels = 1;
  std::uint64_t detailFaces = 0;
  std::uint32_t baseFaces = 0;
  /// Whether every segment has vertex colours, and the base those or a texture.
  bool hasColour = false;
  /// Whether payloads, be it the base alone, have textures; of these media types.
  bool hasTextures = false;
  std::vector<std::string> imageTypes;
  /// How far the base is drawn pushed back along the line of sight, metres.
  double deviationM = 0.0;
};

/// Segments over each base face: `segments[offsets[f] .. offsets[f + 1]]`, ascending.
struct Cover {
  std::vector<std::uint32_t> offsets;
  std::vector<std::uint32_t> segments;

  std::uint32_t faceCount() const { return offsets.empty() ? 0 : static_cast<std::uint32_t>(offsets.size() - 1); }
};

/// Where a region is seen best.
struct RegionPlace {
  /// On the ground, metres, scene frame.
  Vec3 position;
  /// Where to look, clockwise from north.
  double headingDeg = 0.0;
  /// Of a landing that shows the region.
  double radiusM = 0.0;
};

/// One row of regions.json, with the label of labels.json. What is absent is not known.
struct RegionFacts {
  std::uint32_t id = 0;
  std::optional<std::uint32_t> stableId;
  std::optional<std::string> label;
  std::optional<double> areaM2;
  /// sRGB, 0 to 255.
  std::optional<Vec3> meanColour;
  std::optional<double> slopeDeg;
  std::optional<Vec3> centroid;
  std::optional<RegionPlace> place;
};

/// Two pieces that are united at a cost: regions by their id, or R + m for what union m made, R being the regions' number.
struct RegionUnion {
  std::uint32_t one = 0;
  std::uint32_t other = 0;
  double cost = 0.0;
};

/// Everything that is loaded once for a version of a scene. Shared, and never changed after loading.
struct SceneFiles {
  SceneManifest manifest;
  SegmentMesh base;
  /// The GLB of the base: `base.image` lies in it.
  SharedPayload basePayload;
  Cover cover;
  std::vector<RegionFacts> regions;
  /// How regions unite to coarser pieces; empty where the scene does not say.
  std::vector<RegionUnion> unions;
};

using SharedSceneFiles = std::shared_ptr<const SceneFiles>;

/// East, north, height in the survey's CRS, metres.
TERRAPORTCORE_API Vec3 toSurvey(const SceneManifest& manifest, const Vec3& position);

/// x, y, z in the scene's frame, metres, of a point in the survey's CRS.
TERRAPORTCORE_API Vec3 fromSurvey(const SceneManifest& manifest, const Vec3& survey);

}  // namespace terraport
