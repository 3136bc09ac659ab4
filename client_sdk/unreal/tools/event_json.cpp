#include "event_json.h"

#include <cstdio>

namespace terraport::tools {
namespace {

std::string hex(std::uint64_t value) {
  char digits[17];
  std::snprintf(digits, sizeof digits, "%016llx", static_cast<unsigned long long>(value));
  return digits;
}

void describeNumbers(JsonText& json, const Vec3& value) {
  json.open('[').number(value.x).number(value.y).number(value.z).close(']');
}

void describeVector(JsonText& json, const char* name, const Vec3& value) {
  describeNumbers(json.key(name), value);
}

void describeLink(JsonText& json, const LinkState& link) {
  static const char* const kNames[] = {"connecting", "open", "waiting", "closed"};
  json.key("state").text(kNames[static_cast<int>(link.phase)]);
  json.key("attempt").integer(link.attempt).key("retry_in_ms").number(link.retryInMs);
  json.key("close_code").integer(link.closeCode).key("code").text(link.code).key("message").text(link.message);
}

void describeFacts(JsonText& json, const SegmentFacts& facts) {
  json.open('{').key("id").integer(facts.segment).key("length").integer(facts.length).key("xxh3").text(hex(facts.xxh3));
  json.key("faces").integer(facts.faces).key("vertices").integer(facts.vertices).key("bounds").open('[');
  for (const float value :
      {facts.bounds.minX, facts.bounds.minY, facts.bounds.minZ, facts.bounds.maxX, facts.bounds.maxY, facts.bounds.maxZ}) {
    json.number(static_cast<double>(value));
  }
  json.close(']').close('}');
}

void describePlan(JsonText& json, const PlanFacts& plan) {
  describeVector(json, "position", plan.position);
  json.key("radius_m").number(plan.radiusM).key("effective_radius_m").number(plan.effectiveRadiusM);
  json.key("coarse_radius_m").number(plan.coarseRadiusM.value_or(0.0));
  json.key("load").open('[');
  for (const SegmentFacts& facts : plan.load) {
    describeFacts(json, facts);
  }
  json.close(']').key("keep").integers(plan.keep).key("nearby").integers(plan.nearby);
  json.key("load_bytes").integer(static_cast<std::int64_t>(plan.loadBytes));
  json.key("total_bytes").integer(static_cast<std::int64_t>(plan.totalBytes));
  json.key("total_triangles").integer(static_cast<std::int64_t>(plan.totalTriangles));
  json.key("omitted_segments").integer(static_cast<std::int64_t>(plan.omittedSegments));
  json.key("omitted_by");
  if (plan.omittedBy.empty()) {
    json.null();
  } else {
    json.text(plan.omittedBy);
  }
}

const char* nameOf(GroupRole role) {
  return role == GroupRole::Guide ? "guide" : "member";
}

void describeGroup(JsonText& json, const GroupFacts& group) {
  json.key("group").text(group.name).key("member").integer(group.member).key("role").text(nameOf(group.role));
  json.key("members").open('[');
  for (const GroupMember& one : group.members) {
    json.open('[').integer(one.member);
    (one.name.empty() ? json.null() : json.text(one.name)).text(nameOf(one.role)).boolean(one.isPresent);
    if (one.position) {
      describeNumbers(json, *one.position);
    } else {
      json.null();
    }
    json.close(']');
  }
  json.close(']').key("gathering");
  const GroupGathering& gathering = group.gathering;
  if (gathering.number == 0) {
    json.null();
    return;
  }
  json.open('{').key("number").integer(gathering.number).key("guide").integer(gathering.guide);
  describeVector(json, "position", gathering.position);
  json.key("radius_m").number(gathering.radiusM).key("over").boolean(gathering.isOver);
  json.key("ready").integers(gathering.ready).key("degraded").integers(gathering.degraded);
  json.key("missing").integers(gathering.missing).close('}');
}

void describeHit(JsonText& json, const std::optional<PickHit>& hit) {
  json.key("hit");
  if (!hit) {
    json.null();
    return;
  }
  json.open('{');
  describeVector(json, "position", hit->position);
  json.key("segment").integer(hit->segment).key("region").integer(hit->region).key("height_m").number(hit->heightM);
  json.key("attributes").open('{');
  for (const auto& [name, value] : hit->attributes) {
    json.key(name).number(value);
  }
  json.close('}').close('}');
}

const char* nameOf(EventKind kind) {
  switch (kind) {
    case EventKind::Link:
      return "link";
    case EventKind::Opened:
      return "opened";
    case EventKind::Planned:
      return "planned";
    case EventKind::Arrived:
      return "arrived";
    case EventKind::Degraded:
      return "degraded";
    case EventKind::Ready:
      return "ready";
    case EventKind::Superseded:
      return "superseded";
    case EventKind::Prefetching:
      return "prefetching";
    case EventKind::Prefetched:
      return "prefetched";
    case EventKind::Dropped:
      return "dropped";
    case EventKind::Refused:
      return "refused";
    case EventKind::Notice:
      return "notice";
    case EventKind::Picked:
      return "picked";
    case EventKind::PickRefused:
      return "pick_refused";
    case EventKind::GroupJoined:
      return "group_joined";
    case EventKind::GroupRoster:
      return "group_roster";
    case EventKind::GroupCalled:
      return "group_called";
    case EventKind::GroupGathered:
      return "group_gathered";
    case EventKind::GroupRefused:
      return "group_refused";
  }
  return "";
}

}  // namespace

void describeEvent(JsonText& json, const StreamEvent& event) {
  // 1. What every event has.
  json.open('{').key("type").text(nameOf(event.kind)).key("landing");
  if (event.landing == kNoLanding) {
    json.null();
  } else {
    json.integer(event.landing);
  }
  // 2. What each kind adds (Types.h).
  switch (event.kind) {
    case EventKind::Link:
      describeLink(json, event.link);
      break;
    case EventKind::Opened:
      json.key("scene_version").text(event.sceneVersion).key("session").text(event.session);
      json.key("changed").boolean(event.changed).key("held_count").integer(static_cast<std::int64_t>(event.heldCount));
      break;
    case EventKind::Planned:
      describePlan(json, event.plan);
      break;
    case EventKind::Arrived:
      json.key("facts");
      describeFacts(json, event.facts);
      break;
    case EventKind::Degraded:
    case EventKind::Dropped:
      json.key("segments").integers(event.segments);
      break;
    case EventKind::Ready:
      json.key("visible").integers(event.segments).key("missing").integers(event.missing);
      json.key("elapsed_ms").number(event.elapsedMs);
      json.key("payload_bytes").integer(static_cast<std::int64_t>(event.payloadBytes));
      break;
    case EventKind::Superseded:
      json.key("by").integer(event.by);
      break;
    case EventKind::Prefetching:
    case EventKind::Prefetched:
      json.key("segments").integer(static_cast<std::int64_t>(event.segmentCount));
      json.key("bytes").integer(static_cast<std::int64_t>(event.payloadBytes));
      break;
    case EventKind::Refused:
      json.key("code").text(event.code).key("message").text(event.message).key("fatal").boolean(event.fatal);
      break;
    case EventKind::Notice:
      json.key("kind").text(event.noticeKind);
      break;
    case EventKind::Picked:
      json.key("request").integer(static_cast<std::int64_t>(event.request));
      describeHit(json, event.hit);
      break;
    case EventKind::GroupJoined:
    case EventKind::GroupRoster:
    case EventKind::GroupCalled:
    case EventKind::GroupGathered:
      describeGroup(json, *event.group);
      break;
    case EventKind::GroupRefused:
    case EventKind::PickRefused:
      json.key("request").integer(static_cast<std::int64_t>(event.request)).key("code").text(event.code);
      break;
  }
  json.close('}');
}

void describeStats(JsonText& json, const StreamStats& stats) {
  const auto count = [&json](
                         const char* name, std::uint64_t value) { json.key(name).integer(static_cast<std::int64_t>(value)); };
  json.open('{');
  count("payload_bytes", stats.payloadBytes);
  count("repeated_bytes", stats.repeatedBytes);
  count("held_segments", stats.heldSegments);
  count("held_bytes", stats.heldBytes);
  count("aimed_landings", stats.aimedLandings);
  count("aim_hits", stats.aimHits);
  count("prefetched_bytes", stats.prefetchedBytes);
  count("used_prefetched_bytes", stats.usedPrefetchedBytes);
  json.close('}');
}

}  // namespace terraport::tools
