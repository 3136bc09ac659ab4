// Named regions and coarser pieces: the answers of the Python SDK's places.py and coarser.py.
#include "Core/Extras/Places.h"

#include <algorithm>
#include <map>
#include <tuple>

namespace terraport {
namespace {

/// Of a landing where the scene says none, metres.
constexpr double kRadiusM = 60.0;

std::string folded(std::string_view text) {
  std::string out(text);
  for (char& letter : out) letter = letter >= 'A' && letter <= 'Z' ? static_cast<char>(letter - 'A' + 'a') : letter;
  return out;
}

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && text.front() == ' ') text.remove_prefix(1);
  while (!text.empty() && text.back() == ' ') text.remove_suffix(1);
  return text;
}

CoarserPiece pieceOf(const std::vector<Region>& regions, double cost, std::vector<std::uint32_t> members) {
  CoarserPiece piece;
  piece.cost = cost;
  std::sort(members.begin(), members.end());
  std::map<std::string, double> areaOfName;
  for (const std::uint32_t member : members) {
    const double area = regions[member].areaM2.value_or(0.0);
    piece.areaM2 += area;
    if (!regions[member].label.empty()) areaOfName[regions[member].label] += area;
  }
  // Ascending by name: of equal areas the last name stays, as in the other clients.
  double largest = -1.0;
  for (const auto& [name, area] : areaOfName) {
    if (area >= largest) {
      largest = area;
      piece.label = name;
    }
  }
  piece.regions = std::move(members);
  return piece;
}

}  // namespace

std::vector<NamedPlace> placesOf(const std::vector<Region>& regions) {
  std::vector<NamedPlace> places;
  for (std::size_t id = 0; id < regions.size(); ++id) {
    const Region& region = regions[id];
    if (region.label.empty() || (!region.viewpoint && !region.centroid)) continue;
    NamedPlace place;
    place.label = region.label;
    place.stableId = region.stableId;
    place.region = static_cast<std::uint32_t>(id);
    place.areaM2 = region.areaM2;
    place.position = region.viewpoint ? region.viewpoint->position : *region.centroid;
    place.radiusM = region.viewpoint ? region.viewpoint->radiusM : kRadiusM;
    place.isView = region.viewpoint.has_value();
    if (region.viewpoint) place.headingDeg = region.viewpoint->headingDeg;
    places.push_back(std::move(place));
  }
  std::sort(places.begin(), places.end(), [](const NamedPlace& a, const NamedPlace& b) {
    const std::string one = folded(a.label), other = folded(b.label);
    return std::make_tuple(std::cref(one), -a.areaM2.value_or(0.0), a.region) <
        std::make_tuple(std::cref(other), -b.areaM2.value_or(0.0), b.region);
  });
  return places;
}

const NamedPlace* findPlace(const std::vector<NamedPlace>& places, std::string_view wanted) {
  const std::string text = folded(trimmed(wanted));
  for (const NamedPlace& place : places) {
    if (folded(place.label) == text) return &place;
  }
  for (const NamedPlace& place : places) {
    if (place.stableId && std::to_string(*place.stableId) == text) return &place;
  }
  return nullptr;
}

std::vector<CoarserPiece> coarserPieces(
    const std::vector<Region>& regions, const std::vector<Union>& unions, std::uint32_t region) {
  std::vector<CoarserPiece> pieces;
  const auto count = static_cast<std::uint32_t>(regions.size());
  if (region >= count) return pieces;
  // 1. Up from the region: the unions that it takes part in, the last of each cost.
  std::vector<std::uint32_t> found;
  std::uint32_t at = region;
  for (std::uint32_t place = 0; place < unions.size(); ++place) {
    if (unions[place].one != at && unions[place].other != at) continue;
    at = count + place;
    if (!found.empty() && unions[found.back()].cost == unions[place].cost) found.pop_back();
    found.push_back(place);
  }
  // 2. Down from each to its regions. A piece that two unions name counts once: a reader bounds nothing else of the list.
  std::vector<std::uint32_t> open;
  std::vector<bool> seen(regions.size() + unions.size());
  for (const std::uint32_t place : found) {
    std::fill(seen.begin(), seen.end(), false);
    std::vector<std::uint32_t> members;
    open.assign(1, count + place);
    while (!open.empty()) {
      const std::uint32_t piece = open.back();
      open.pop_back();
      if (seen[piece]) continue;
      seen[piece] = true;
      if (piece < count) {
        members.push_back(piece);
        continue;
      }
      open.push_back(unions[piece - count].one);
      open.push_back(unions[piece - count].other);
    }
    pieces.push_back(pieceOf(regions, unions[place].cost, std::move(members)));
  }
  return pieces;
}

}  // namespace terraport
