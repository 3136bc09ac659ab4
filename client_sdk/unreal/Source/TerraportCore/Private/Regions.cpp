// regions.json and labels.json (scene format, section 11).
#include <cmath>
#include <utility>

#include "JsonExpect.h"
#include "Manifest.h"
#include "Utf8.h"

namespace terraport {
namespace {

constexpr std::size_t kLongestLabel = 256;
constexpr std::size_t kMaxLabelBytes = std::size_t{64} << 20;

std::optional<std::uint32_t> wholeOf(JsonValue value) {
  const auto whole = value.integer();
  if (!whole || *whole < 0 || *whole > 0xFFFFFFFFLL) {
    return std::nullopt;
  }
  return static_cast<std::uint32_t>(*whole);
}

std::optional<double> numberOf(JsonValue value) {
  const auto number = value.number();
  return number && std::isfinite(*number) ? number : std::nullopt;
}

std::optional<Vec3> tripleOf(JsonValue value) {
  double numbers[3] = {0.0, 0.0, 0.0};
  if (!expectTriple(value, "", numbers).isOk()) {
    return std::nullopt;
  }
  return Vec3{numbers[0], numbers[1], numbers[2]};
}

/// Unicode's control characters in UTF-8: U+0000 to U+001F, U+007F, and U+0080 to U+009F, which are C2 80 to C2 9F.
bool hasControls(std::string_view text) {
  for (std::size_t at = 0; at < text.size(); ++at) {
    const auto byte = static_cast<std::uint8_t>(text[at]);
    const auto next = static_cast<std::uint8_t>(at + 1 < text.size() ? text[at + 1] : 0);
    if (byte < 0x20 || byte == 0x7f || (byte == 0xc2 && next >= 0x80 && next < 0xa0)) {
      return true;
    }
  }
  return false;
}

bool startsOrEnds(std::string_view text, std::string_view affix) {
  return text.substr(0, affix.size()) == affix ||
      (text.size() >= affix.size() && text.substr(text.size() - affix.size()) == affix);
}

/// A blank at either end: those of Unicode that are no controls.
bool hasBlankEnds(std::string_view text) {
  constexpr std::string_view kBlanks[] = {" ", "\xc2\xa0", "\xe1\x9a\x80", "\xe2\x80\x80", "\xe2\x80\x81", "\xe2\x80\x82",
      "\xe2\x80\x83", "\xe2\x80\x84", "\xe2\x80\x85", "\xe2\x80\x86", "\xe2\x80\x87", "\xe2\x80\x88", "\xe2\x80\x89",
      "\xe2\x80\x8a", "\xe2\x80\xa8", "\xe2\x80\xa9", "\xe2\x80\xaf", "\xe2\x81\x9f", "\xe3\x80\x80"};
  for (const std::string_view blank : kBlanks) {
    if (startsOrEnds(text, blank)) {
      return true;
    }
  }
  return false;
}

/// 1 to 256 code points, no control character, no blank at either end.
bool isLabel(std::string_view text) {
  return !text.empty() && !hasControls(text) && !hasBlankEnds(text) && codePointCount(text) <= kLongestLabel;
}

std::optional<RegionPlace> placeOf(JsonValue value) {
  const auto position = tripleOf(value.member("position"));
  const auto heading = numberOf(value.member("heading_deg")), radius = numberOf(value.member("radius_m"));
  if (!position || !heading || !radius || *radius <= 0.0) {
    return std::nullopt;
  }
  return RegionPlace{*position, *heading, *radius};
}

RegionFacts readRegion(JsonValue region, std::uint32_t id, const RegionLabels& labels) {
  RegionFacts facts;
  facts.id = id;
  facts.stableId = wholeOf(region.member("stable_id"));
  const auto relabelled = facts.stableId ? labels.find(*facts.stableId) : labels.end();
  const auto label = region.member("label").text();
  if (relabelled != labels.end()) {
    facts.label = relabelled->second;
  } else if (label && !label->empty()) {
    facts.label = std::string(*label);
  }
  facts.areaM2 = numberOf(region.member("area_m2"));
  facts.meanColour = tripleOf(region.member("mean_colour"));
  facts.slopeDeg = numberOf(region.member("slope_deg").member("mean"));
  facts.centroid = tripleOf(region.member("centroid"));
  facts.place = placeOf(region.member("place"));
  return facts;
}

/// None where a number is missing, an end is not of the pieces before, or the two are one or in another order.
std::optional<RegionUnion> unionOf(JsonValue row, std::size_t pieces) {
  if (!row.isList() || row.size() != 3) {
    return std::nullopt;
  }
  auto item = row.items().begin();
  const auto one = wholeOf(*item), other = wholeOf(*++item);
  const auto cost = numberOf(*++item);
  if (!one || !other || !cost || *one >= *other || *other >= pieces) {
    return std::nullopt;
  }
  return RegionUnion{*one, *other, *cost};
}

}  // namespace

RegionLabels readLabels(ByteSpan json) {
  JsonDocument document;
  JsonLimits limits;
  limits.maxBytes = kMaxLabelBytes;
  if (!document.read(textOf(json), limits).isOk()) {
    return {};
  }
  const JsonValue root = document.root();
  const std::string_view version = root.member("format_version").text().value_or("");
  const JsonValue rows = root.member("labels");
  if (root.member("format").text().value_or("") != "terraport-labels" || version.substr(0, version.find('.')) != "1" ||
      !rows.isList()) {
    return {};
  }
  RegionLabels labels;
  std::int64_t before = -1;
  for (const JsonValue row : rows.items()) {
    const auto stableId = wholeOf(row.member("stable_id"));
    const auto label = row.member("label").text();
    if (!stableId || *stableId <= before || !label || !isLabel(*label)) {
      return {};
    }
    labels.emplace(*stableId, std::string(*label));
    before = *stableId;
  }
  return labels;
}

Status readRegions(ByteSpan json, const RegionLabels& labels, std::vector<RegionFacts>& out, std::vector<RegionUnion>& unions) {
  out.clear();
  unions.clear();
  JsonDocument document;
  JsonLimits limits;
  limits.maxBytes = kMaxRegionsBytes;
  limits.maxValues = 1U << 26;
  if (!document.read(textOf(json), limits).isOk()) {
    return Status::damaged("regions.json is no JSON");
  }
  const JsonValue regions = document.root().member("regions");
  TERRAPORT_RETURN_IF_ERROR(expectList(regions, "regions"));
  for (const JsonValue region : regions.items()) {
    const auto id = static_cast<std::uint32_t>(out.size());
    if (!region.isMap() || region.member("id").integer().value_or(-1) != static_cast<std::int64_t>(id)) {
      return Status::damaged("region " + std::to_string(id) + " has another id, expected its position");
    }
    out.push_back(readRegion(region, id, labels));
  }
  const JsonValue rows = document.root().member("unions");
  if (rows.isList()) {
    for (const JsonValue row : rows.items()) {
      const auto next = unionOf(row, out.size() + unions.size());
      if (!next) {
        break;  // what follows would name pieces that are not there
      }
      unions.push_back(*next);
    }
  }
  return {};
}

}  // namespace terraport
