// Written by `python -m terraport_wire.schema` from the message classes in Python; do not edit.

#pragma once

#include "Messages.generated.h"

namespace terraport {

/// The fields of a message or part, in the order of writing: `visitor.field(name, value, kind)`
/// for each, until one returns false.
template <typename Message>
struct FieldsOf;

template <>
struct FieldsOf<BudgetsPart> {
  static constexpr const char* kType = "budgets";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("max_triangles", message.maxTriangles, IntegerKind{0, 9007199254740991}) &&
           visitor.field("max_bytes", message.maxBytes, IntegerKind{0, 9007199254740991}) &&
           visitor.field("max_segments", message.maxSegments, IntegerKind{0, 9007199254740991}) &&
           visitor.field("max_gpu_bytes", message.maxGpuBytes, IntegerKind{0, 9007199254740991}) &&
           visitor.field("gpu_vertex_bytes", message.gpuVertexBytes, IntegerKind{1, 4096}) &&
           visitor.field("gpu_face_bytes", message.gpuFaceBytes, IntegerKind{1, 4096});
  }
};

template <>
struct FieldsOf<SceneInfoPart> {
  static constexpr const char* kType = "sceneinfo";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("id", message.id, TextKind{1, 128, TextPattern::Any}) &&
           visitor.field("version", message.version, TextKind{1, 64, TextPattern::Any}) &&
           visitor.field("name", message.name, TextKind{0, 256, TextPattern::Any}) &&
           visitor.field("segment_count", message.segmentCount, IntegerKind{0, 4294967295}) &&
           visitor.field("levels", message.levels, IntegerKind{1, 2});
  }
};

template <>
struct FieldsOf<ServerLimitsPart> {
  static constexpr const char* kType = "serverlimits";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("max_radius_m", message.maxRadiusM, NumberKind{0.0, 1000000.0, true}) &&
           visitor.field("max_message_bytes", message.maxMessageBytes, IntegerKind{1, 9007199254740991}) &&
           visitor.field("max_messages_per_s", message.maxMessagesPerS, NumberKind{0.0, 1000000000.0, true}) &&
           visitor.field("max_held_segments", message.maxHeldSegments, IntegerKind{0, 32768}) &&
           visitor.field("max_plan_segments", message.maxPlanSegments, IntegerKind{0, 16384}) &&
           visitor.field("max_credit_bytes", message.maxCreditBytes, IntegerKind{1, 9007199254740991}) &&
           visitor.field("idle_timeout_s", message.idleTimeoutS, NumberKind{0.0, 1000000000.0, true}) &&
           visitor.field("groups", message.groups, choiceOf("none", "here", "query"));
  }
};

template <>
struct FieldsOf<PullInfoPart> {
  static constexpr const char* kType = "pullinfo";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("base", message.base, TextKind{0, 2048, TextPattern::Any}) &&
           visitor.field("pack", message.pack, TextKind{1, 201, TextPattern::Any}) &&
           visitor.field("pack_bytes", message.packBytes, IntegerKind{1, 9007199254740991});
  }
};

template <>
struct FieldsOf<TimingsPart> {
  static constexpr const char* kType = "timings";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("plan_us", message.planUs, IntegerKind{0, 9007199254740991}) &&
           visitor.field("first_byte_us", message.firstByteUs, IntegerKind{0, 9007199254740991}) &&
           visitor.field("last_byte_us", message.lastByteUs, IntegerKind{0, 9007199254740991}) &&
           visitor.field("ready_us", message.readyUs, IntegerKind{0, 9007199254740991}) &&
           visitor.field("credit_wait_us", message.creditWaitUs, IntegerKind{0, 9007199254740991});
  }
};

template <>
struct FieldsOf<HitPart> {
  static constexpr const char* kType = "hit";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("position", message.position, PositionKind{10000000.0, false}) &&
           visitor.field("normal", message.normal, PositionKind{1.5, false}) &&
           visitor.field("segment", message.segment, IntegerKind{0, 4294967295}) &&
           visitor.field("region", message.region, IntegerKind{0, 4294967295}) &&
           visitor.field("stable_id", message.stableId, IntegerKind{0, 4294967295}) &&
           visitor.field("label", message.label, TextKind{0, 256, TextPattern::Any}) &&
           visitor.field("height_m", message.heightM, NumberKind{-1000000000.0, 1000000000.0, false}) &&
           visitor.field("attributes", message.attributes, NumbersKind{64});
  }
};

template <>
struct FieldsOf<MemberPart> {
  static constexpr const char* kType = "member";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("member", message.member, IntegerKind{1, 4294967295}) &&
           visitor.field("name", message.name, TextKind{1, 64, TextPattern::Any}) &&
           visitor.field("role", message.role, choiceOf("guide", "member")) &&
           visitor.field("present", message.present, FlagKind{}) &&
           visitor.field("position", message.position, PositionKind{10000000.0, false});
  }
};

template <>
struct FieldsOf<HelloMessage> {
  static constexpr const char* kType = "hello";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("protocol", message.protocol, VersionKind{}) &&
           visitor.field("client", message.client, TextKind{0, 128, TextPattern::Any}) &&
           visitor.field("token", message.token, TextKind{0, 4096, TextPattern::Any}) &&
           visitor.field("encoding", message.encoding, choiceOf("segment-2")) &&
           visitor.field("budgets", message.budgets, PartKind{}) &&
           visitor.field("credit_bytes", message.creditBytes, IntegerKind{0, 9007199254740991}) &&
           visitor.field("release_factor", message.releaseFactor, NumberKind{1.0, 4.0, false}) &&
           visitor.field("scene_version", message.sceneVersion, TextKind{0, 64, TextPattern::Any}) &&
           visitor.field("held", message.held, RowsKind{32768}) &&
           visitor.field("delivery", message.delivery, choiceOf("push", "pull")) &&
           visitor.field("timings", message.timings, FlagKind{});
  }
};

template <>
struct FieldsOf<AimMessage> {
  static constexpr const char* kType = "aim";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("generation", message.generation, IntegerKind{0, 4294967295}) &&
           visitor.field("position", message.position, PositionKind{10000000.0, false}) &&
           visitor.field("radius_m", message.radiusM, NumberKind{0.0, 1000000.0, true}) &&
           visitor.field("coarse_radius_m", message.coarseRadiusM, NumberKind{0.0, 1000000.0, true});
  }
};

template <>
struct FieldsOf<LandMessage> {
  static constexpr const char* kType = "land";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("generation", message.generation, IntegerKind{0, 4294967295}) &&
           visitor.field("position", message.position, PositionKind{10000000.0, false}) &&
           visitor.field("radius_m", message.radiusM, NumberKind{0.0, 1000000.0, true}) &&
           visitor.field("inner_radius_m", message.innerRadiusM, NumberKind{0.0, 1000000.0, true}) &&
           visitor.field("deadline_ms", message.deadlineMs, IntegerKind{1, 600000}) &&
           visitor.field("stall_ms", message.stallMs, IntegerKind{1, 600000}) &&
           visitor.field("coarse_radius_m", message.coarseRadiusM, NumberKind{0.0, 1000000.0, true});
  }
};

template <>
struct FieldsOf<CreditMessage> {
  static constexpr const char* kType = "credit";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("bytes", message.bytes, IntegerKind{1, 9007199254740991});
  }
};

template <>
struct FieldsOf<EvictMessage> {
  static constexpr const char* kType = "evict";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("segments", message.segments, RowsKind{32768});
  }
};

template <>
struct FieldsOf<RejectMessage> {
  static constexpr const char* kType = "reject";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("generation", message.generation, IntegerKind{0, 4294967295}) &&
           visitor.field("segment", message.segment, IntegerKind{0, 4294967295}) &&
           visitor.field("reason", message.reason, TextKind{0, 64, TextPattern::Any});
  }
};

template <>
struct FieldsOf<PickMessage> {
  static constexpr const char* kType = "pick";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("request", message.request, IntegerKind{0, 4294967295}) &&
           visitor.field("origin", message.origin, PositionKind{10000000.0, false}) &&
           visitor.field("direction", message.direction, PositionKind{10000000.0, true});
  }
};

template <>
struct FieldsOf<HeldMessage> {
  static constexpr const char* kType = "held";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("segments", message.segments, RowsKind{32768});
  }
};

template <>
struct FieldsOf<ByeMessage> {
  static constexpr const char* kType = "bye";
  template <typename Visitor, typename Message>
  static bool visit(Visitor&, Message&) {
    return true;
  }
};

template <>
struct FieldsOf<JoinMessage> {
  static constexpr const char* kType = "join";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("request", message.request, IntegerKind{0, 4294967295}) &&
           visitor.field("group", message.group, TextKind{1, 64, TextPattern::GroupName}) &&
           visitor.field("role", message.role, choiceOf("guide", "member")) &&
           visitor.field("name", message.name, TextKind{1, 64, TextPattern::Any}) &&
           visitor.field("seat", message.seat, TextKind{1, 64, TextPattern::Any});
  }
};

template <>
struct FieldsOf<LeaveMessage> {
  static constexpr const char* kType = "leave";
  template <typename Visitor, typename Message>
  static bool visit(Visitor&, Message&) {
    return true;
  }
};

template <>
struct FieldsOf<GatherMessage> {
  static constexpr const char* kType = "gather";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("request", message.request, IntegerKind{0, 4294967295}) &&
           visitor.field("position", message.position, PositionKind{10000000.0, false}) &&
           visitor.field("radius_m", message.radiusM, NumberKind{0.0, 1000000.0, true}) &&
           visitor.field("inner_radius_m", message.innerRadiusM, NumberKind{0.0, 1000000.0, true}) &&
           visitor.field("deadline_ms", message.deadlineMs, IntegerKind{1, 600000});
  }
};

template <>
struct FieldsOf<ArrivedMessage> {
  static constexpr const char* kType = "arrived";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("gathering", message.gathering, IntegerKind{1, 4294967295}) &&
           visitor.field("state", message.state, choiceOf("ready", "degraded", "declined"));
  }
};

template <>
struct FieldsOf<WelcomeMessage> {
  static constexpr const char* kType = "welcome";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("protocol", message.protocol, VersionKind{}) &&
           visitor.field("server", message.server, TextKind{0, 128, TextPattern::Any}) &&
           visitor.field("session", message.session, TextKind{0, 64, TextPattern::Any}) &&
           visitor.field("scene", message.scene, PartKind{}) &&
           visitor.field("limits", message.limits, PartKind{}) &&
           visitor.field("release_factor", message.releaseFactor, NumberKind{1.0, 4.0, false}) &&
           visitor.field("dropped", message.dropped, RowsKind{32768}) &&
           visitor.field("held_count", message.heldCount, IntegerKind{0, 32768}) &&
           visitor.field("pull", message.pull, PartKind{});
  }
};

template <>
struct FieldsOf<HeldCheckedMessage> {
  static constexpr const char* kType = "held_checked";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("dropped", message.dropped, RowsKind{32768}) &&
           visitor.field("held_count", message.heldCount, IntegerKind{0, 4294967295});
  }
};

template <>
struct FieldsOf<PlanMessage> {
  static constexpr const char* kType = "plan";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("generation", message.generation, IntegerKind{0, 4294967295}) &&
           visitor.field("position", message.position, PositionKind{10000000.0, false}) &&
           visitor.field("radius_m", message.radiusM, NumberKind{0.0, 1000000.0, true}) &&
           visitor.field("release_radius_m", message.releaseRadiusM, NumberKind{0.0, 4000000.0, true}) &&
           visitor.field("effective_radius_m", message.effectiveRadiusM, NumberKind{0.0, 1000000.0, false}) &&
           visitor.field("inner_count", message.innerCount, IntegerKind{0, 16384}) &&
           visitor.field("load", message.load, RowsKind{16384}) &&
           visitor.field("keep", message.keep, RowsKind{16384}) &&
           visitor.field("nearby", message.nearby, RowsKind{16384}) &&
           visitor.field("load_bytes", message.loadBytes, IntegerKind{0, 9007199254740991}) &&
           visitor.field("load_triangles", message.loadTriangles, IntegerKind{0, 9007199254740991}) &&
           visitor.field("total_bytes", message.totalBytes, IntegerKind{0, 9007199254740991}) &&
           visitor.field("total_triangles", message.totalTriangles, IntegerKind{0, 9007199254740991}) &&
           visitor.field("omitted_segments", message.omittedSegments, IntegerKind{0, 4294967295}) &&
           visitor.field("omitted_by", message.omittedBy, choiceOf("max_triangles", "max_bytes", "max_segments", "max_gpu_bytes")) &&
           visitor.field("total_gpu_bytes", message.totalGpuBytes, IntegerKind{0, 9007199254740991}) &&
           visitor.field("blocks", message.blocks, RowsKind{16384});
  }
};

template <>
struct FieldsOf<PrefetchMessage> {
  static constexpr const char* kType = "prefetch";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("generation", message.generation, IntegerKind{0, 4294967295}) &&
           visitor.field("segments", message.segments, RowsKind{16384}) &&
           visitor.field("bytes", message.bytes, IntegerKind{0, 9007199254740991}) &&
           visitor.field("blocks", message.blocks, RowsKind{16384});
  }
};

template <>
struct FieldsOf<ReadyMessage> {
  static constexpr const char* kType = "ready";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("generation", message.generation, IntegerKind{0, 4294967295}) &&
           visitor.field("delivered", message.delivered, IntegerKind{0, 16384}) &&
           visitor.field("payload_bytes", message.payloadBytes, IntegerKind{0, 9007199254740991}) &&
           visitor.field("missing", message.missing, RowsKind{16384}) &&
           visitor.field("timings", message.timings, PartKind{});
  }
};

template <>
struct FieldsOf<DegradedMessage> {
  static constexpr const char* kType = "degraded";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("generation", message.generation, IntegerKind{0, 4294967295}) &&
           visitor.field("segments", message.segments, RowsKind{16384});
  }
};

template <>
struct FieldsOf<SupersededMessage> {
  static constexpr const char* kType = "superseded";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("generation", message.generation, IntegerKind{0, 4294967295}) &&
           visitor.field("by", message.by, IntegerKind{0, 4294967295}) &&
           visitor.field("unsent_bytes", message.unsentBytes, IntegerKind{0, 9007199254740991});
  }
};

template <>
struct FieldsOf<PickedMessage> {
  static constexpr const char* kType = "picked";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("request", message.request, IntegerKind{0, 4294967295}) &&
           visitor.field("hit", message.hit, PartKind{});
  }
};

template <>
struct FieldsOf<NoticeMessage> {
  static constexpr const char* kType = "notice";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("kind", message.kind, TextKind{1, 64, TextPattern::Word}) &&
           visitor.field("version", message.version, TextKind{0, 64, TextPattern::Any}) &&
           visitor.field("reconnect_after_ms", message.reconnectAfterMs, IntegerKind{0, 9007199254740991});
  }
};

template <>
struct FieldsOf<ErrorMessage> {
  static constexpr const char* kType = "error";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("code", message.code, TextKind{1, 64, TextPattern::Word}) &&
           visitor.field("message", message.message, TextKind{0, 1024, TextPattern::Any}) &&
           visitor.field("fatal", message.fatal, FlagKind{}) &&
           visitor.field("generation", message.generation, IntegerKind{0, 4294967295}) &&
           visitor.field("request", message.request, IntegerKind{0, 4294967295}) &&
           visitor.field("protocols", message.protocols, VersionsKind{16});
  }
};

template <>
struct FieldsOf<JoinedMessage> {
  static constexpr const char* kType = "joined";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("request", message.request, IntegerKind{0, 4294967295}) &&
           visitor.field("group", message.group, TextKind{1, 64, TextPattern::GroupName}) &&
           visitor.field("member", message.member, IntegerKind{1, 4294967295}) &&
           visitor.field("role", message.role, choiceOf("guide", "member")) &&
           visitor.field("seat", message.seat, TextKind{1, 64, TextPattern::Any});
  }
};

template <>
struct FieldsOf<RosterMessage> {
  static constexpr const char* kType = "roster";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("group", message.group, TextKind{1, 64, TextPattern::GroupName}) &&
           visitor.field("members", message.members, PartsKind{1024});
  }
};

template <>
struct FieldsOf<GatheringMessage> {
  static constexpr const char* kType = "gathering";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("gathering", message.gathering, IntegerKind{1, 4294967295}) &&
           visitor.field("guide", message.guide, IntegerKind{1, 4294967295}) &&
           visitor.field("position", message.position, PositionKind{10000000.0, false}) &&
           visitor.field("radius_m", message.radiusM, NumberKind{0.0, 1000000.0, true}) &&
           visitor.field("inner_radius_m", message.innerRadiusM, NumberKind{0.0, 1000000.0, true}) &&
           visitor.field("left_ms", message.leftMs, IntegerKind{0, 600000});
  }
};

template <>
struct FieldsOf<GatheredMessage> {
  static constexpr const char* kType = "gathered";
  template <typename Visitor, typename Message>
  static bool visit(Visitor& visitor, Message& message) {
    return visitor.field("gathering", message.gathering, IntegerKind{1, 4294967295}) &&
           visitor.field("ready", message.ready, RowsKind{1024}) &&
           visitor.field("degraded", message.degraded, RowsKind{1024}) &&
           visitor.field("missing", message.missing, RowsKind{1024});
  }
};

}  // namespace terraport
