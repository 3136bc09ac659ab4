#include "Core/Scene.h"

#include <map>
#include <utility>

#include "Core/Value.h"

namespace terraport {
namespace {

constexpr double kMaxNumber = std::numeric_limits<double>::max();
constexpr std::int64_t kMaxFileBytes = std::int64_t{1} << 30;
constexpr std::size_t kMaxAttributes = 32;
constexpr std::size_t kMaxText = 1024;
constexpr std::size_t kMaxLabel = 256;

using Labels = std::map<std::int64_t, std::string>;

Status wrong(const std::string& what) {
  return Status::damaged("manifest has no valid " + what + "; the scene must be published again");
}

bool hasControls(const std::string& text) {
  for (const char letter : text) {
    if (static_cast<unsigned char>(letter) < 0x20 || letter == 0x7f) return true;
  }
  return false;
}

/// All labels, or none where one is wrong.
Labels readLabels(ByteSpan json) {
  Value document;
  if (!readJson(json, document).isOk() || document["format"].text != "terraport-labels") return {};
  Labels labels;
  for (const Value& row : document["labels"].items) {
    const auto id = row["stable_id"].integerIn(labels.empty() ? 0 : labels.rbegin()->first + 1, kMaxU32);
    const auto label = row["label"].textUpTo(kMaxLabel);
    if (!id || !label || label->empty() || hasControls(*label)) return {};
    labels.emplace(*id, *label);
  }
  return labels;
}

Region readRegion(const Value& value, const Labels& labels) {
  Region region;
  if (const auto id = value["stable_id"].integerIn(0, kMaxU32)) region.stableId = static_cast<std::uint32_t>(*id);
  region.label = value["label"].textUpTo(kMaxText).value_or("");
  const auto renamed = region.stableId ? labels.find(*region.stableId) : labels.end();
  if (renamed != labels.end()) region.label = renamed->second;
  region.areaM2 = value["area_m2"].numberIn(0.0, kMaxNumber);
  region.meanColour = value["mean_colour"].point();
  region.centroid = value["centroid"].point();
  const Value& place = value["place"];
  const auto position = place["position"].point();
  const auto heading = place["heading_deg"].numberIn(-kMaxNumber, kMaxNumber), radius = place["radius_m"].numberIn(1e-9, 1e9);
  if (position && heading && radius) region.viewpoint = Viewpoint{*position, *heading, *radius};
  return region;
}

}  // namespace

Status readManifest(ByteSpan json, Scene& scene) {
  Value document;
  if (!readJson(json, document).isOk() || document["format"].text != "terraport-scene") {
    return Status::damaged("got no manifest of a scene; is this a terraport server?");
  }
  if (document["format_version"].text.substr(0, 2) != "1.") {
    return Status::failed("unsupported_version",
        "got scene format " + document["format_version"].text.substr(0, 16) + ", expected 1.x; a newer client is needed");
  }
  scene.version = document["version"].textUpTo(64).value_or("");
  const auto origin = document["origin"].point(), low = document["bounds"]["min"].point(),
             high = document["bounds"]["max"].point();
  const auto deviation = document["hand_off"]["deviation_m"].numberIn(0.0, kMaxNumber);
  const auto segments = document["counts"]["segments"].integerIn(1, kMaxU32);
  const auto levels = document["levels"].isAbsent() ? std::optional<std::int64_t>(1) : document["levels"].integerIn(1, 2);
  const auto baseBytes = document["files"]["base.tsg"]["bytes"].integerIn(1, kMaxFileBytes);
  const auto regionsBytes = document["files"]["regions.json"]["bytes"].integerIn(1, kMaxFileBytes);
  if (scene.version.empty()) return wrong("version");
  if (!origin || !low || !high || !deviation) return wrong("origin, bounds or hand_off");
  if (!segments || !levels) return wrong("counts or levels");
  if (!baseBytes || !regionsBytes) return wrong("base.tsg or regions.json in its files");
  if (!document["encodings"]["segment-2"].isMap()) return wrong("encoding segment-2");
  scene.origin = *origin;
  scene.boundsMin = *low;
  scene.boundsMax = *high;
  scene.deviationM = *deviation;
  scene.segmentCount = static_cast<std::uint32_t>(*segments);
  scene.levels = static_cast<std::uint32_t>(*levels);
  scene.baseBytes = static_cast<std::uint64_t>(*baseBytes);
  scene.regionsBytes = static_cast<std::uint64_t>(*regionsBytes);
  for (const Value& each : document["attributes"].items) {
    const auto offset = each["offset"].numberIn(-kMaxNumber, kMaxNumber), step = each["step"].numberIn(-kMaxNumber, kMaxNumber);
    if (!offset || !step || scene.attributes.size() == kMaxAttributes) return wrong("attributes");
    scene.attributes.push_back({each["name"].textUpTo(kMaxText).value_or(""), *offset, *step});
  }
  return {};
}

Status readBase(SharedBytes payload, Scene& scene) {
  const Status status = SegmentDecoder().decode(*payload, scene.attributes.size(), SegmentDecoder::Kind::Base, scene.base);
  scene.basePayload = std::move(payload);
  return status.isOk() ? status : Status::damaged("base.tsg: " + status.message());
}

Status readRegions(ByteSpan regionsJson, ByteSpan labelsJson, Scene& scene) {
  Value document;
  if (!readJson(regionsJson, document).isOk() || !document["regions"].isList()) {
    return Status::damaged("regions.json has no list of regions");
  }
  const Labels labels = readLabels(labelsJson);
  for (const Value& each : document["regions"].items) {
    if (each["id"].integerIn(0, kMaxU32) != std::optional<std::int64_t>(scene.regions.size())) {
      return Status::damaged("region " + std::to_string(scene.regions.size()) + " has another id, expected its position");
    }
    scene.regions.push_back(readRegion(each, labels));
  }
  for (const Value& row : document["unions"].items) {
    const auto pieces = static_cast<std::int64_t>(scene.regions.size() + scene.unions.size());
    if (row.items.size() != 3) break;
    const auto other = row.items[1].integerIn(1, pieces - 1), one = row.items[0].integerIn(0, other.value_or(0) - 1);
    const auto cost = row.items[2].numberIn(-kMaxNumber, kMaxNumber);
    if (!one || !other || !cost) break;  // What follows would name pieces that are not there.
    scene.unions.push_back({static_cast<std::uint32_t>(*one), static_cast<std::uint32_t>(*other), *cost});
  }
  return {};
}

}  // namespace terraport
