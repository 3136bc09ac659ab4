// Named regions as places to go to, and the coarser pieces of ground that a region is part of (scene format, section 11.1).
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "Core/Scene.h"

namespace terraport {

/// A region with a name, and where to stand to see it: "take me to the stockpile".
struct NamedPlace {
  /// Several regions may have one name.
  std::string label;
  std::optional<std::uint32_t> stableId;
  /// Its number in this version, as picks have it.
  std::uint32_t region = 0;
  std::optional<double> areaM2;
  /// Metres, scene frame: on the ground where `isView`, else the region's middle.
  Vec3 position;
  /// Where to look, clockwise from north; none where nobody chose.
  std::optional<double> headingDeg;
  /// Of a landing that shows the region.
  double radiusM = 0.0;
  /// Whether the position was chosen for its view.
  bool isView = false;
};

/// A coarser piece of ground: regions that are united at a cost.
struct CoarserPiece {
  double cost = 0.0;
  /// Ascending.
  std::vector<std::uint32_t> regions;
  double areaM2 = 0.0;
  /// What most of its named ground is called; empty where none has a name.
  std::string label;
};

/// The named regions: by name whatever its ASCII case, the largest of each name first. Regions of which the scene does not say
/// where they are are left out.
std::vector<NamedPlace> placesOf(const std::vector<Region>& regions);

/// The place of that name, whatever its ASCII case, or of that stable id in digits; of several the first. Null where there is
/// none.
const NamedPlace* findPlace(const std::vector<NamedPlace>& places, std::string_view wanted);

/// The pieces that a region is part of, finest first: one for each cost at which more is united, each holding those before.
/// Empty for a region that is not there. O(unions + regions of the pieces).
std::vector<CoarserPiece> coarserPieces(
    const std::vector<Region>& regions, const std::vector<Union>& unions, std::uint32_t region);

}  // namespace terraport
