// What a client loads of a scene once: its manifest, base mesh and regions (spec/scene-format.md).
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "Core/Basics.h"
#include "Core/Segment.h"

namespace terraport {

/// Where a region is seen best.
struct Viewpoint {
  Vec3 position;
  /// Where to look, clockwise from north.
  double headingDeg = 0.0;
  /// Of a landing that shows the region.
  double radiusM = 0.0;
};

struct Region {
  std::optional<std::uint32_t> stableId;
  /// As it is now; empty without one.
  std::string label;
  std::optional<double> areaM2;
  /// Mean sRGB levels.
  std::optional<Vec3> meanColour;
  std::optional<Vec3> centroid;
  std::optional<Viewpoint> viewpoint;
};

/// Two pieces, regions or earlier unions (numbered after the regions), and what uniting them costs.
struct Union {
  std::uint32_t one = 0;
  std::uint32_t other = 0;
  double cost = 0.0;
};

struct Scene {
  std::string version;
  /// The scene frame's origin in the survey's reference system: east, north, height.
  Vec3 origin;
  Vec3 boundsMin, boundsMax;
  /// Measured distance between base and detail.
  double deviationM = 0.0;
  std::uint32_t segmentCount = 0;
  std::uint32_t levels = 1;
  std::vector<AttributeScale> attributes;
  /// Bytes of base.tsg and regions.json.
  std::uint64_t baseBytes = 0, regionsBytes = 0;

  SegmentMesh base;
  /// For the base's image.
  SharedBytes basePayload;
  std::vector<Region> regions;
  std::vector<Union> unions;

  /// East, north and height of a position of the scene frame, and back.
  Vec3 toSurvey(const Vec3& p) const { return {origin.x + p.x, origin.y - p.z, origin.z + p.y}; }
  Vec3 fromSurvey(const Vec3& p) const { return {p.x - origin.x, p.z - origin.z, origin.y - p.y}; }
};

using SharedScene = std::shared_ptr<const Scene>;

/// Read scene.json, as a service sends it.
Status readManifest(ByteSpan json, Scene& scene);

/// Read base.tsg of a scene whose manifest was read.
Status readBase(SharedBytes payload, Scene& scene);

/// Read regions.json, with the names in labels.json, which replace its own; labels that cannot be read are ignored.
Status readRegions(ByteSpan regionsJson, ByteSpan labelsJson, Scene& scene);

}  // namespace terraport
