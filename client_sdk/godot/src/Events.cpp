#include "Events.h"

#include <algorithm>

namespace terraport::godot {

namespace {

Variant number(std::uint64_t value) {
  return Variant(static_cast<std::int64_t>(value));
}

const char* nameOf(LinkPhase phase) {
  switch (phase) {
    case LinkPhase::Connecting:
      return "connecting";
    case LinkPhase::Open:
      return "open";
    case LinkPhase::Waiting:
      return "waiting";
    case LinkPhase::Closed:
      return "closed";
  }
  return "";
}

const char* nameOf(LandingPhase phase) {
  switch (phase) {
    case LandingPhase::None:
      return "none";
    case LandingPhase::Planning:
      return "planning";
    case LandingPhase::Loading:
      return "loading";
    case LandingPhase::PresentableDegraded:
      return "presentable_degraded";
    case LandingPhase::Presentable:
      return "presentable";
    case LandingPhase::ShownDegraded:
      return "shown_degraded";
    case LandingPhase::Shown:
      return "shown";
    case LandingPhase::Refused:
      return "refused";
  }
  return "";
}

const char* nameOf(EventKind kind) {
  switch (kind) {
    case EventKind::GroupCalled:
      return "group_called";
    case EventKind::GroupGathered:
      return "group_gathered";
    case EventKind::GroupRefused:
      return "group_refused";
    default:
      return "group_changed";
  }
}

const char* nameOf(GroupRole role) {
  return role == GroupRole::Guide ? "guide" : "member";
}

Variant numbers(const std::vector<std::uint32_t>& values) {
  List list;
  for (const std::uint32_t value : values) list.add(number(value));
  return list.variant();
}

void fillPick(Dictionary& facts, const PickHit& hit) {
  Dictionary attributes;
  for (const auto& [name, value] : hit.attributes) attributes.set(name.c_str(), value);
  facts.set("position", hit.position)
      .set("normal", hit.normal)
      .set("segment", number(hit.segment))
      .set("region", number(hit.region))
      .set("label", hit.label ? Variant(*hit.label) : Variant())
      .set("height_m", hit.heightM)
      .set("attributes", attributes.variant());
}

}  // namespace

void EventList::add(const char* name, const Dictionary& facts) {
  List event;
  event.add(name);
  event.add(facts.variant());
  list_.add(event.variant());
}

void EventList::failed(const std::string& code, const std::string& message, std::int64_t landing, bool isFinal) {
  Dictionary facts;
  facts.set("code", code).set("message", message).set("landing", landing).set("final", isFinal);
  add("failed", facts);
}

void EventList::add(const StreamEvent& event) {
  Dictionary facts;
  facts.set("landing", event.landing);
  switch (event.kind) {
    case EventKind::Link:
      facts.set("state", nameOf(event.link.phase))
          .set("attempt", number(event.link.attempt))
          .set("retry_in_ms", event.link.retryInMs)
          .set("close_code", event.link.closeCode)
          .set("code", event.link.code)
          .set("message", event.link.message);
      return add("link", facts);
    case EventKind::Planned:
      facts.set("radius_m", event.plan.radiusM)
          .set("effective_radius_m", event.plan.effectiveRadiusM)
          .set("coarse_radius_m", event.plan.coarseRadiusM.value_or(0.0))
          .set("load_segments", number(event.plan.load.size()))
          .set("kept_segments", number(event.plan.keep.size()))
          .set("load_bytes", number(event.plan.loadBytes))
          .set("triangles", number(event.plan.totalTriangles))
          .set("omitted_segments", number(event.plan.omittedSegments))
          .set("omitted_by", event.plan.omittedBy);
      return add("planned", facts);
    case EventKind::Ready:
      facts.set("segments", number(event.segments.size()))
          .set("missing", number(event.missing.size()))
          .set("elapsed_ms", event.elapsedMs)
          .set("payload_bytes", number(event.payloadBytes));
      return add("ready", facts);
    case EventKind::Degraded:
      return add("degraded", facts);
    case EventKind::Superseded:
      facts.set("by", event.by);
      return add("superseded", facts);
    case EventKind::Prefetched:
      facts.set("segments", number(event.segmentCount)).set("payload_bytes", number(event.payloadBytes));
      return add("prefetched", facts);
    case EventKind::Refused:
      // What ends a connection is told by the link event that follows, which also says whether it is for good.
      if (!event.fatal) failed(event.code, event.message, event.landing, false);
      return;
    case EventKind::Picked:
      facts.set("request", number(event.request)).set("hit", event.hit.has_value());
      if (event.hit) fillPick(facts, *event.hit);
      return add("picked", facts);
    case EventKind::PickRefused:
      return failed(event.code, event.message, kNoLanding, false);
    case EventKind::GroupJoined:
    case EventKind::GroupRoster:
    case EventKind::GroupCalled:
    case EventKind::GroupGathered:
    case EventKind::GroupRefused: {
      const std::optional<GroupFacts>& group = event.group;
      if (event.kind == EventKind::GroupCalled) {
        facts.set("position", group->gathering.position).set("radius_m", group->gathering.radiusM);
      }
      facts.set("group", describe(group)).set("code", event.code).set("message", event.message);
      return add(nameOf(event.kind), facts);
    }
    default:
      return;
  }
}

void EventList::add(const SceneSwap& swap) {
  Dictionary facts;
  facts.set("landing", swap.landing)
      .set("degraded", swap.degraded)
      .set("shown", number(swap.shown.size()))
      .set("hidden", number(swap.hidden.size()))
      .set("base_blocks", number(swap.baseBlocks.size()));
  add("shown", facts);
}

Variant describe(const LandingStatus& status) {
  Dictionary facts;
  facts.set("phase", nameOf(status.phase))
      .set("landing", status.landing)
      .set("position", status.position)
      .set("radius_m", status.radiusM)
      .set("effective_radius_m", status.effectiveRadiusM)
      .set("fraction", status.fraction)
      .set("missing", number(status.missing.size()))
      .set("refusal", status.refusal)
      .set("ready_ms", status.readyMs)
      .set("presentable_ms", status.presentableMs)
      .set("payload_bytes", number(status.payloadBytes));
  return facts.variant();
}

Variant describe(const std::optional<GroupFacts>& group) {
  if (!group) return Variant();
  List members;
  for (const GroupMember& one : group->members) {
    Dictionary facts;
    facts.set("member", number(one.member)).set("name", one.name).set("role", nameOf(one.role)).set("present", one.isPresent);
    if (one.position) facts.set("position", *one.position);
    members.add(facts.variant());
  }
  const GroupGathering& there = group->gathering;
  Dictionary facts;
  facts.set("name", group->name)
      .set("member", number(group->member))
      .set("role", nameOf(group->role))
      .set("members", members.variant())
      .set("gathering", number(there.number))
      .set("guide", number(there.guide))
      .set("over", there.isOver)
      .set("ready", numbers(there.ready))
      .set("degraded", numbers(there.degraded))
      .set("missing", numbers(there.missing));
  return facts.variant();
}

Variant describe(const SceneManifest& manifest) {
  List attributes;
  for (const AttributeInfo& attribute : manifest.attributes) {
    Dictionary facts;
    facts.set("name", attribute.name)
        .set("min", attribute.min ? Variant(*attribute.min) : Variant())
        .set("max", attribute.max ? Variant(*attribute.max) : Variant());
    attributes.add(facts.variant());
  }
  Dictionary facts;
  facts.set("id", manifest.id)
      .set("name", manifest.name)
      .set("version", manifest.version)
      .set("crs", manifest.crs ? Variant(manifest.crs->name) : Variant())
      .set("bounds_min", manifest.boundsMin)
      .set("bounds_max", manifest.boundsMax)
      .set("segments", number(manifest.segmentCount))
      .set("detail_faces", number(manifest.detailFaces))
      .set("base_faces", number(manifest.baseFaces))
      .set("attributes", attributes.variant());
  return facts.variant();
}

Variant describe(const std::vector<Place>& places) {
  List list;
  for (const Place& place : places) {
    Dictionary facts;
    facts.set("label", place.label)
        .set("region", number(place.region))
        .set("stable_id", place.stableId ? number(*place.stableId) : Variant())
        .set("area_m2", place.areaM2 ? Variant(*place.areaM2) : Variant())
        .set("position", place.position)
        .set("heading_deg", place.headingDeg ? Variant(*place.headingDeg) : Variant())
        .set("radius_m", place.radiusM)
        .set("is_view", place.isView);
    list.add(facts.variant());
  }
  return list.variant();
}

Variant describe(const std::vector<CoarserPiece>& pieces) {
  List list;
  for (const CoarserPiece& piece : pieces) {
    Dictionary facts;
    facts.set("cost", piece.cost)
        .set("regions",
            arrayOf<std::int32_t>(
                piece.regions.size(), [&](std::int32_t* out) { std::copy(piece.regions.begin(), piece.regions.end(), out); }))
        .set("area_m2", piece.areaM2)
        .set("label", piece.label ? Variant(*piece.label) : Variant());
    list.add(facts.variant());
  }
  return list.variant();
}

Variant describe(const std::vector<RegionFacts>& regions) {
  List list;
  for (const RegionFacts& region : regions) {
    Dictionary facts;
    facts.set("id", number(region.id))
        .set("label", region.label ? Variant(*region.label) : Variant())
        .set("area_m2", region.areaM2 ? Variant(*region.areaM2) : Variant())
        .set("mean_colour", region.meanColour ? Variant(*region.meanColour) : Variant())
        .set("slope_deg", region.slopeDeg ? Variant(*region.slopeDeg) : Variant())
        .set("centroid", region.centroid ? Variant(*region.centroid) : Variant());
    list.add(facts.variant());
  }
  return list.variant();
}

}  // namespace terraport::godot
