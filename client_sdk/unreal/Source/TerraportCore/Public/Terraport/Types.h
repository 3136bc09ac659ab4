// The values that pass between the parts of the client. Lengths are metres of the scene frame (right-handed, x east, y up,
// z south, about the scene's origin); segment ids are rows of the scene's index.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace terraport {

/// A view: whoever made it keeps the bytes alive while it is used.
struct ByteSpan {
  const std::uint8_t* data = nullptr;
  std::size_t size = 0;
};

/// A view of all bytes; `bytes` must outlive it unchanged.
inline ByteSpan viewOf(const std::vector<std::uint8_t>& bytes) {
  return {bytes.data(), bytes.size()};
}

/// A payload as it came, kept alive by whoever holds it: the cache may let it go while a decoder still reads it.
using SharedPayload = std::shared_ptr<const std::vector<std::uint8_t>>;

/// Landing of an event that belongs to none.
constexpr std::int64_t kNoLanding = -1;

/// Metres of the scene frame, or a direction in it.
struct Vec3 {
  double x = 0.0;
  double y = 0.0;
  double z = 0.0;
};

/// An axis-aligned box, metres of the scene frame.
struct Box {
  float minX = 0.0F;
  float minY = 0.0F;
  float minZ = 0.0F;
  float maxX = 0.0F;
  float maxY = 0.0F;
  float maxZ = 0.0F;
};

/// In which form payloads are asked for: the one that `decodePayload` reads.
constexpr char kPayloadEncoding[] = "segment-2";

/// What the index says of one segment.
struct SegmentFacts {
  std::uint32_t segment = 0;
  /// Payload bytes.
  std::uint32_t length = 0;
  /// XXH3-64 of the payload.
  std::uint64_t xxh3 = 0;
  std::uint32_t faces = 0;
  std::uint32_t vertices = 0;
  Box bounds;
};

/// Hard bounds of every landing; an absent one does not bound.
struct Budgets {
  std::optional<std::uint64_t> maxTriangles;
  /// Payload bytes.
  std::optional<std::uint64_t> maxBytes;
  std::optional<std::uint64_t> maxSegments;
  /// On the client's GPU; with it what a vertex and a triangle's indices take there (wire protocol, section 6.2).
  std::optional<std::uint64_t> maxGpuBytes;
  std::optional<std::uint32_t> gpuVertexBytes;
  std::optional<std::uint32_t> gpuFaceBytes;
};

/// A ring of the coarser level, and how long a landing may take before its inner part is acceptable (wire protocol, 6.1 and
/// 6.4, rule 3).
struct LandOptions {
  /// Beyond the radius everything up to here comes at its coarser level, where the scene has one; metres, at least the radius,
  /// and cut to what the server allows. A SceneStage asks for one by itself.
  std::optional<double> coarseRadiusM;
  /// Radius of the degraded set, metres; at most the landing's radius.
  std::optional<double> innerRadiusM;
  /// Milliseconds after which the inner set alone is acceptable, 1 to 600,000; needs `innerRadiusM`.
  std::optional<std::uint32_t> deadlineMs;
  /// Milliseconds without progress after which it is, too; needs `innerRadiusM`.
  std::optional<std::uint32_t> stallMs;
};

/// The plan of a landing.
struct PlanFacts {
  std::int64_t landing = kNoLanding;
  Vec3 position;
  double radiusM = 0.0;
  /// The radius within which everything is loaded: smaller than `radiusM` where a budget bound it.
  double effectiveRadiusM = 0.0;
  /// How far the coarser level reaches beyond it; absent where there is none of it.
  std::optional<double> coarseRadiusM;
  /// What will be sent, nearest first.
  std::vector<SegmentFacts> load;
  /// What of the rest within the radius is here already.
  std::vector<std::uint32_t> keep;
  /// Held beyond the radius: kept ready for a hop back, not shown.
  std::vector<std::uint32_t> nearby;
  std::uint64_t loadBytes = 0;
  std::uint64_t totalBytes = 0;
  std::uint64_t totalTriangles = 0;
  std::uint64_t omittedSegments = 0;
  /// The budget that bound it (`max_triangles`, `max_bytes`, `max_segments`); empty where none did.
  std::string omittedBy;
};

/// Answer to a pick that met the ground.
struct PickHit {
  Vec3 position;
  /// Unit, on the face's front side.
  Vec3 normal;
  std::uint32_t segment = 0;
  /// Region of the face, in this scene version.
  std::uint32_t region = 0;
  /// Number of the region that is the same in every version, where it has one.
  std::optional<std::uint32_t> stableId;
  /// Text from people.
  std::optional<std::string> label;
  /// Height in the survey's own vertical reference, metres.
  double heightM = 0.0;
  std::map<std::string, double> attributes;
};

enum class LinkPhase : std::uint8_t {
  Connecting,
  Open,
  /// Lost; another attempt follows by itself.
  Waiting,
  /// For good, until `reconnect` is called.
  Closed,
};

enum class GroupRole : std::uint8_t {
  Member,
  /// Lands the group; there is one at most.
  Guide,
};

/// How a member's part of a group landing ended.
enum class GroupArrival : std::uint8_t {
  /// Its landing can be shown, or is.
  Ready,
  /// Its inner part can be shown, the rest is coming.
  Degraded,
  /// It does not come: nobody waits for it.
  Declined,
};

/// Somebody in a group.
struct GroupMember {
  /// Number in the group, never given again in it.
  std::uint32_t member = 0;
  /// What it calls itself: text from a stranger, to be shown as such. Empty where it has no name.
  std::string name;
  GroupRole role = GroupRole::Member;
  /// False where its connection is lost and its seat is kept.
  bool isPresent = false;
  /// Centre of its last landing, metres of the scene frame; absent before the first.
  std::optional<Vec3> position;
};

/// A landing of a whole group.
struct GroupGathering {
  /// Rises from landing to landing of the group, from 1; 0 before the first.
  std::uint32_t number = 0;
  /// Number of the member who asked for it.
  std::uint32_t guide = 0;
  Vec3 position;
  /// What the guide asks everybody to load.
  double radiusM = 0.0;
  /// What may be shown first where time is short.
  std::optional<double> innerRadiusM;
  /// How long the others wait at most, as of when it was told; absent where nobody waits.
  std::optional<std::uint32_t> leftMs;
  /// The barrier is open: all have arrived, or nobody waits any more.
  bool isOver = false;
  /// Members that show their landing, that show the inner part alone, and that declined or said nothing in time; known once it
  /// is over.
  std::vector<std::uint32_t> ready;
  std::vector<std::uint32_t> degraded;
  std::vector<std::uint32_t> missing;
};

/// The group that a session has a seat in, as it was when an event told of it.
struct GroupFacts {
  std::string name;
  /// Own number in the group, and own role.
  std::uint32_t member = 0;
  GroupRole role = GroupRole::Member;
  /// Everybody, ascending number; empty until the first list has come.
  std::vector<GroupMember> members;
  /// The newest landing of the group.
  GroupGathering gathering;
};

/// Where the connection stands.
struct LinkState {
  LinkPhase phase = LinkPhase::Connecting;
  /// From 1; in Connecting and Waiting.
  std::uint32_t attempt = 0;
  /// Runs from the event; in Waiting.
  double retryInMs = 0.0;
  /// WebSocket close code; in Waiting and Closed.
  int closeCode = 0;
  /// An error code of the wire protocol, or "closed"; in Waiting and Closed.
  std::string code;
  std::string message;
};

/// What has been counted since the stream was made.
struct StreamStats {
  std::uint64_t payloadBytes = 0;
  /// Of those, for segments that were held already; 0 with a right server.
  std::uint64_t repeatedBytes = 0;
  std::uint64_t heldSegments = 0;
  std::uint64_t heldBytes = 0;
  /// Landings that had an aim before them, and those of them with nothing left to load.
  std::uint64_t aimedLandings = 0;
  std::uint64_t aimHits = 0;
  std::uint64_t prefetchedBytes = 0;
  std::uint64_t usedPrefetchedBytes = 0;
};

enum class EventKind : std::uint8_t {
  /// `link`.
  Link,
  /// `sceneVersion`, `session`, `changed`, `maxRadiusM`, `heldCount`.
  Opened,
  /// `plan`, `landing`. After a reconnect a landing gets another one.
  Planned,
  /// A segment is whole and verified: `facts`; `landing`, or kNoLanding for what an aim brought.
  Arrived,
  /// The deadline passed, and `segments` may be shown before the rest: `landing`.
  Degraded,
  /// Exactly `segments` (ascending) must be shown: `landing`, `missing`, `elapsedMs`, `payloadBytes`.
  Ready,
  /// `landing`, `by`.
  Superseded,
  /// An aim is answered: `segmentCount`, `payloadBytes`.
  Prefetching,
  /// What an aim brings is all here: `segmentCount`, `payloadBytes`.
  Prefetched,
  /// `segments` are not held any more.
  Dropped,
  /// `code`, `message`, `fatal`; `landing` or kNoLanding.
  Refused,
  /// `noticeKind`, `sceneVersion` (empty for none), `reconnectAfterMs`.
  Notice,
  /// `request`; `hit`, absent where nothing is met.
  Picked,
  /// `request`, `code`, `message`.
  PickRefused,
  /// The session has a seat in its group, or has it again after a reconnect: `group`.
  GroupJoined,
  /// Who is in the group: `group`.
  GroupRoster,
  /// The guide lands the group: `group`, its gathering. Land there, or do not, and say so by `arrive`.
  GroupCalled,
  /// The barrier of the gathering is open: `group`.
  GroupGathered,
  /// A join or gather was refused: `request`, `code`, `message`; `group`, absent where the seat is gone.
  GroupRefused,
};

/// An event of a stream. Which fields count is said at the kind. Landing numbers stay the same over reconnects.
struct StreamEvent {
  EventKind kind = EventKind::Link;
  std::int64_t landing = kNoLanding;
  SegmentFacts facts;
  std::vector<std::uint32_t> segments;
  std::vector<std::uint32_t> missing;
  PlanFacts plan;
  LinkState link;
  std::string sceneVersion;
  /// The server's name for the session, for logs.
  std::string session;
  /// The served version is another one than before: base and cover must be loaded anew (wire protocol, 5.4).
  bool changed = false;
  double maxRadiusM = 0.0;
  std::uint64_t heldCount = 0;
  /// From the call of `land` until all bytes were there and verified.
  double elapsedMs = 0.0;
  std::uint64_t payloadBytes = 0;
  std::uint64_t segmentCount = 0;
  /// The landing that superseded.
  std::int64_t by = kNoLanding;
  std::string code;
  std::string message;
  bool fatal = false;
  std::string noticeKind;
  std::optional<double> reconnectAfterMs;
  std::uint64_t request = 0;
  std::optional<PickHit> hit;
  std::optional<GroupFacts> group;
};

}  // namespace terraport
