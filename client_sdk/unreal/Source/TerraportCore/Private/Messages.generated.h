// Written by `python -m terraport_wire.schema` from the message classes in Python; do not edit.

#pragma once

#include "WireKinds.h"

#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace terraport {

/// Version of the protocol that this client speaks.
constexpr ProtocolVersion kProtocol{1, 0};

/// The WebSocket subprotocol: its name pins the major version.
constexpr const char* kSubprotocol = "terraport.v1.msgpack";

/// Bounds that every speaker keeps (section 12); a server may be stricter.
namespace limits {
constexpr std::uint64_t kBlockBytes = 64;
constexpr std::uint64_t kHeaderBytes = 24;
constexpr std::uint64_t kMaxAttributes = 64;
constexpr std::uint64_t kMaxChunkBytes = 131048;
constexpr std::uint64_t kMaxClientMessageBytes = 1048576;
constexpr std::uint64_t kMaxClientValues = 1024;
constexpr std::uint64_t kMaxContainerItems = 16384;
constexpr double kMaxCoordinateM = 10000000.0;
constexpr std::uint64_t kMaxDeadlineMs = 600000;
constexpr std::uint64_t kMaxDepth = 16;
constexpr std::uint64_t kMaxFrameBytes = 131072;
constexpr std::uint64_t kMaxGpuElementBytes = 4096;
constexpr std::uint64_t kMaxGroupMembers = 1024;
constexpr std::uint64_t kMaxGroupName = 64;
constexpr std::uint64_t kMaxHeaderBytes = 1024;
constexpr std::uint64_t kMaxHeldSegments = 32768;
constexpr std::uint64_t kMaxInteger = 9007199254740991;
constexpr std::uint64_t kMaxLevels = 2;
constexpr std::uint64_t kMaxPlanSegments = 16384;
constexpr double kMaxRadiusM = 1000000.0;
constexpr double kMaxReleaseFactor = 4.0;
constexpr std::uint64_t kMaxSegmentBytes = 67108864;
constexpr std::uint64_t kMaxServerMessageBytes = 8388608;
constexpr std::uint64_t kMaxTokenBytes = 4096;
}  // namespace limits

/// An error code, and the close code where it is fatal (section 11).
struct CloseCodeRow {
  const char* error;
  int closeCode;
};

constexpr CloseCodeRow kCloseCodes[] = {
    {"malformed", 4400},
    {"invalid_field", 4400},
    {"out_of_order", 4400},
    {"radius_too_large", 4400},
    {"unauthorised", 4401},
    {"forbidden", 4403},
    {"unknown_scene", 4404},
    {"timeout", 4408},
    {"unsupported_version", 4409},
    {"unsupported_encoding", 4409},
    {"too_large", 4413},
    {"too_many", 4429},
    {"internal", 4500},
    {"draining", 4503},
    {"group_refused", 4403},
};

/// What one landing may hold in all (load and keep together); absent means unlimited.
struct BudgetsPart {
  /// Most triangles.
  std::optional<std::uint64_t> maxTriangles;
  /// Most payload bytes.
  std::optional<std::uint64_t> maxBytes;
  /// Most segments.
  std::optional<std::uint64_t> maxSegments;
  /// Most bytes on the client's GPU (section 6.2).
  std::optional<std::uint64_t> maxGpuBytes;
  /// Bytes of a vertex in the client's buffers; absent means 24.
  std::optional<std::uint32_t> gpuVertexBytes;
  /// Bytes of a triangle's three indices in them; absent means 6.
  std::optional<std::uint32_t> gpuFaceBytes;
};

/// Which scene is served.
struct SceneInfoPart {
  /// Id of the scene in URLs.
  std::string id;
  /// Version; changes whenever any byte does.
  std::string version;
  /// Name for people.
  std::string name;
  /// Segments of the scene: ids are below it, those of coarser levels above (section 6.1).
  std::uint32_t segmentCount = 0;
  /// Levels of every segment; absent means 1.
  std::optional<std::uint32_t> levels;
};

/// What this server allows on this connection.
struct ServerLimitsPart {
  /// Largest radius of aim and land.
  double maxRadiusM = 0;
  /// Largest message to the server.
  std::uint64_t maxMessageBytes = 0;
  /// Messages per second, averaged over 10 s.
  double maxMessagesPerS = 0;
  /// Most segments in hello.held.
  std::uint32_t maxHeldSegments = 0;
  /// Most segments in a plan, as a budget would cut.
  std::uint32_t maxPlanSegments = 0;
  /// Most outstanding credit; more is clamped.
  std::uint64_t maxCreditBytes = 0;
  /// Silence after which the server closes.
  double idleTimeoutS = 0;
  /// Whether groups can be joined: `here`; `query`: only where the URL of the stream names the group; `none`. Absent means `none`.
  std::optional<std::string> groups;
};

/// Where a client that pulls fetches payload.
struct PullInfoPart {
  /// Base address, ending in `/`: `http` or `https`, or relative to the server URL.
  std::string base;
  /// Path of the pack below the base address; its bytes never change.
  std::string pack;
  /// Length of the pack.
  std::uint64_t packBytes = 0;
};

/// When the server did what for one landing, in microseconds since it received land.
struct TimingsPart {
  /// Plan handed to the socket; absent where the plan was still waiting for that.
  std::optional<std::uint64_t> planUs;
  /// First chunk on its way; absent where there was none.
  std::optional<std::uint64_t> firstByteUs;
  /// Last chunk on its way; absent where there was none.
  std::optional<std::uint64_t> lastByteUs;
  /// Ready decided.
  std::uint64_t readyUs = 0;
  /// How long there was payload to send and no credit: time that the client took.
  std::uint64_t creditWaitUs = 0;
};

/// What a pick met.
struct HitPart {
  /// Point of the surface, metres of the scene frame.
  Vec3 position;
  /// Unit normal of the face.
  Vec3 normal;
  /// Segment of the face.
  std::uint32_t segment = 0;
  /// Region of the face, in this scene version.
  std::uint32_t region = 0;
  /// Number of the region that is the same in every version of the scene, where it has one.
  std::optional<std::uint32_t> stableId;
  /// Label of the region when the pick is answered, where it has one.
  std::optional<std::string> label;
  /// Height in metres in the survey's own vertical reference.
  double heightM = 0;
  /// Survey attributes there, without gaps.
  std::vector<NamedNumber> attributes;
};

/// One seat of a group.
struct MemberPart {
  /// Number in the group, never given again in it.
  std::uint32_t member = 0;
  /// What it calls itself, for people.
  std::optional<std::string> name;
  /// A group has one guide at most.
  std::string role;
  /// False where its connection is lost and its seat is kept.
  bool present = false;
  /// Centre of its last landing, metres of the scene frame (x, y, z); absent before the first.
  std::optional<Vec3> position;
};

/// First message of a connection: who the client is, what it can take, what it holds.
struct HelloMessage {
  /// Newest version that the client speaks.
  ProtocolVersion protocol;
  /// Name and version of the client, for logs.
  std::string client;
  /// Bearer token, where it was not given before.
  std::optional<std::string> token;
  /// Payload encoding that the client wants.
  std::string encoding;
  /// Hard bounds of every landing.
  BudgetsPart budgets;
  /// First credit: payload bytes that may be sent at once.
  std::uint64_t creditBytes = 0;
  /// Release radius / load radius; absent means the server's default.
  std::optional<double> releaseFactor;
  /// Scene version that the client knows; absent means the newest.
  std::optional<std::string> sceneVersion;
  /// Segments that the client holds whole, with their hashes.
  std::optional<std::vector<HeldRow>> held;
  /// How payload comes: `push`, in frames of this connection; `pull`, fetched by the client (section 17). Absent means `push`.
  std::optional<std::string> delivery;
  /// True: send timings with every ready; absent means false.
  std::optional<bool> timings;
};

/// The user points at a place: send ahead, at low priority, what a landing there needs.
struct AimMessage {
  /// Number of the aim or land; strictly increasing on one connection.
  std::uint32_t generation = 0;
  /// Centre in metres of the scene frame (x, y, z).
  Vec3 position;
  /// Radius in metres around the centre.
  double radiusM = 0;
  /// Radius in metres of the coarser level: beyond radius_m up to it; at least radius_m.
  std::optional<double> coarseRadiusM;
};

/// The user teleports: answer with one plan, send its segments, say ready.
struct LandMessage {
  /// Number of the aim or land; strictly increasing on one connection.
  std::uint32_t generation = 0;
  /// Centre in metres of the scene frame (x, y, z).
  Vec3 position;
  /// Radius in metres around the centre.
  double radiusM = 0;
  /// Radius in metres of the degraded set; at most radius_m.
  std::optional<double> innerRadiusM;
  /// Milliseconds after which the inner set alone is acceptable; needs inner_radius_m.
  std::optional<std::uint32_t> deadlineMs;
  /// Milliseconds without progress after which it is, too; needs inner_radius_m.
  std::optional<std::uint32_t> stallMs;
  /// Radius in metres of the coarser level: beyond radius_m up to it; at least radius_m.
  std::optional<double> coarseRadiusM;
};

/// Grant more payload bytes.
struct CreditMessage {
  /// Payload bytes granted beyond what was before.
  std::uint64_t bytes = 0;
};

/// The client no longer holds these segments.
struct EvictMessage {
  /// Segments no longer held.
  std::vector<std::uint32_t> segments;
};

/// A segment arrived whole but is not usable.
struct RejectMessage {
  /// Generation of the segment's last frame.
  std::uint32_t generation = 0;
  /// The segment.
  std::uint32_t segment = 0;
  /// `hash_mismatch`, `undecodable`, or another word for logs.
  std::string reason;
};

/// Ask what lies along a ray, or above or below a point.
struct PickMessage {
  /// Number chosen by the client, for the answer.
  std::uint32_t request = 0;
  /// Point in metres of the scene frame.
  Vec3 origin;
  /// Direction of the ray, of any length; absent: the vertical line through origin.
  std::optional<Vec3> direction;
};

/// More of what the client holds, after hello and before the first aim or land.
struct HeldMessage {
  /// Segments that the client holds whole, with their hashes.
  std::vector<HeldRow> segments;
};

/// The client ends the session; the server closes with 1000.
struct ByeMessage {
};

/// Take a seat in a group of this scene; it is made if there is none of that name.
struct JoinMessage {
  /// Number chosen by the client, for the answer.
  std::uint32_t request = 0;
  /// Name of the group, within the scene.
  std::string group;
  /// A guide moves the group; one at most.
  std::string role;
  /// What the others call this member.
  std::optional<std::string> name;
  /// Secret of the seat held before, to take it again after a lost connection.
  std::optional<std::string> seat;
};

/// Give up the seat in the group.
struct LeaveMessage {
};

/// The guide lands the group.
struct GatherMessage {
  /// Number chosen by the client, for the answer.
  std::uint32_t request = 0;
  /// Centre in metres of the scene frame (x, y, z).
  Vec3 position;
  /// Radius in metres around the centre.
  double radiusM = 0;
  /// Radius in metres of the degraded set; at most radius_m.
  std::optional<double> innerRadiusM;
  /// Milliseconds after which the barrier opens without who is missing; absent means the server's default.
  std::optional<std::uint32_t> deadlineMs;
};

/// A member's part of a group landing is over.
struct ArrivedMessage {
  /// Number of the group landing, chosen by the server.
  std::uint32_t gathering = 0;
  /// `ready`: shows its landing; `degraded`: its inner set; `declined`: will not come.
  std::string state;
};

/// Answer to hello: the session is open.
struct WelcomeMessage {
  /// Version spoken from now on.
  ProtocolVersion protocol;
  /// Name and version of the server.
  std::string server;
  /// Id of the session, for logs of both sides.
  std::string session;
  /// The scene.
  SceneInfoPart scene;
  /// What the server allows.
  ServerLimitsPart limits;
  /// Release radius / load radius in use.
  double releaseFactor = 0;
  /// Offered segments that this scene version does not have; the client frees them.
  std::vector<std::uint32_t> dropped;
  /// Offered segments that are accepted as held.
  std::uint32_t heldCount = 0;
  /// Where payload is fetched; present where hello asked for `pull` and the server grants it.
  std::optional<PullInfoPart> pull;
};

/// Answer to held: what of it is accepted.
struct HeldCheckedMessage {
  /// Offered segments that this scene version does not have; the client frees them.
  std::vector<std::uint32_t> dropped;
  /// Segments that are held by now.
  std::uint32_t heldCount = 0;
};

/// Answer to land: the one set of segments of this landing.
struct PlanMessage {
  /// Number of the aim or land; strictly increasing on one connection.
  std::uint32_t generation = 0;
  /// Centre, as received.
  Vec3 position;
  /// Radius in metres around the centre.
  double radiusM = 0;
  /// Radius in metres within which held segments are kept.
  double releaseRadiusM = 0;
  /// Everything nearer than this is shown: the largest radius, or less where a budget cut.
  double effectiveRadiusM = 0;
  /// Segments of the plan within inner_radius_m.
  std::uint32_t innerCount = 0;
  /// Segments within radius_m that follow, in sending order.
  std::vector<SegmentFacts> load;
  /// Segments within radius_m that the client holds.
  std::vector<std::uint32_t> keep;
  /// Held segments beyond radius_m within release_radius_m: kept, not shown.
  std::vector<std::uint32_t> nearby;
  /// Payload bytes of load, whole segments.
  std::uint64_t loadBytes = 0;
  /// Triangles of load.
  std::uint64_t loadTriangles = 0;
  /// Payload bytes of load and keep.
  std::uint64_t totalBytes = 0;
  /// Triangles of load and keep.
  std::uint64_t totalTriangles = 0;
  /// Segments within radius_m that a budget left out.
  std::uint32_t omittedSegments = 0;
  /// Budget that the first omitted segment would exceed; absent if none was omitted.
  std::optional<std::string> omittedBy;
  /// GPU bytes of load, keep and nearby; present where hello bounds them.
  std::optional<std::uint64_t> totalGpuBytes;
  /// With `pull`: where the payload of each row begins in the pack, in blocks of 64 bytes.
  std::optional<std::vector<std::uint32_t>> blocks;
};

/// Answer to aim: what is sent ahead.
struct PrefetchMessage {
  /// Number of the aim or land; strictly increasing on one connection.
  std::uint32_t generation = 0;
  /// Segments, in sending order.
  std::vector<SegmentFacts> segments;
  /// Payload bytes of segments, whole.
  std::uint64_t bytes = 0;
  /// With `pull`: where the payload of each row begins in the pack, in blocks of 64 bytes.
  std::optional<std::vector<std::uint32_t>> blocks;
};

/// Every segment of the plan was sent whole, or is listed as missing.
struct ReadyMessage {
  /// Number of the aim or land; strictly increasing on one connection.
  std::uint32_t generation = 0;
  /// Segments of load that were sent whole.
  std::uint32_t delivered = 0;
  /// Payload bytes sent in this generation's frames.
  std::uint64_t payloadBytes = 0;
  /// Segments of the plan that cannot be delivered.
  std::vector<std::uint32_t> missing;
  /// Where hello asked for them.
  std::optional<TimingsPart> timings;
};

/// The deadline has passed and the inner set is whole; streaming goes on to ready.
struct DegradedMessage {
  /// Number of the aim or land; strictly increasing on one connection.
  std::uint32_t generation = 0;
  /// The inner set: what may be shown already.
  std::vector<std::uint32_t> segments;
};

/// An unfinished generation was ended by a newer one.
struct SupersededMessage {
  /// Number of the aim or land; strictly increasing on one connection.
  std::uint32_t generation = 0;
  /// The newer generation.
  std::uint32_t by = 0;
  /// Payload bytes that were not sent.
  std::uint64_t unsentBytes = 0;
};

/// Answer to pick.
struct PickedMessage {
  /// Request, as received.
  std::uint32_t request = 0;
  /// What was met; absent if nothing was.
  std::optional<HitPart> hit;
};

/// News that ends nothing by itself; a client skips kinds that it does not know.
struct NoticeMessage {
  /// `draining`: reconnect soon; `scene_published`: a newer version is served.
  std::string kind;
  /// Version of the new scene.
  std::optional<std::string> version;
  /// Milliseconds to wait before reconnecting.
  std::optional<std::uint64_t> reconnectAfterMs;
};

/// Something was refused or failed.
struct ErrorMessage {
  /// Stable code, see the error codes.
  std::string code;
  /// What was received and what was expected, for people.
  std::string message;
  /// True: the server closes with the code's close code.
  bool fatal = false;
  /// Generation of the refused aim or land.
  std::optional<std::uint32_t> generation;
  /// Request of the refused pick, join or gather.
  std::optional<std::uint32_t> request;
  /// With unsupported_version: the versions offered.
  std::optional<std::vector<ProtocolVersion>> protocols;
};

/// Answer to join: the seat in the group.
struct JoinedMessage {
  /// Request, as received.
  std::uint32_t request = 0;
  /// Name of the group, within the scene.
  std::string group;
  /// Number of this member in the group.
  std::uint32_t member = 0;
  /// As granted.
  std::string role;
  /// Secret by which this seat is taken again, for this client alone.
  std::string seat;
};

/// Who is in the group, newest state; the ones between may be left out.
struct RosterMessage {
  /// Name of the group, within the scene.
  std::string group;
  /// All seats, ascending number.
  std::vector<MemberPart> members;
};

/// The guide lands the group: land there, then say arrived.
struct GatheringMessage {
  /// Number of the group landing, chosen by the server.
  std::uint32_t gathering = 0;
  /// Number of the member who asked for it.
  std::uint32_t guide = 0;
  /// Centre in metres of the scene frame (x, y, z).
  Vec3 position;
  /// Radius in metres around the centre.
  double radiusM = 0;
  /// Radius in metres of the degraded set.
  std::optional<double> innerRadiusM;
  /// Milliseconds until the barrier opens at the latest; absent where it has: nobody waits.
  std::optional<std::uint32_t> leftMs;
};

/// The barrier is open: everybody has arrived, or the deadline has passed.
struct GatheredMessage {
  /// Number of the group landing, chosen by the server.
  std::uint32_t gathering = 0;
  /// Members that show their landing.
  std::vector<std::uint32_t> ready;
  /// Members that show the inner set.
  std::vector<std::uint32_t> degraded;
  /// Members that declined, or did not arrive in time.
  std::vector<std::uint32_t> missing;
};

/// Everything that is sent in one direction.
using ClientMessage = std::variant<
    UnknownMessage,
    HelloMessage,
    AimMessage,
    LandMessage,
    CreditMessage,
    EvictMessage,
    RejectMessage,
    PickMessage,
    HeldMessage,
    ByeMessage,
    JoinMessage,
    LeaveMessage,
    GatherMessage,
    ArrivedMessage>;

/// Everything that is sent in one direction.
using ServerMessage = std::variant<
    UnknownMessage,
    WelcomeMessage,
    HeldCheckedMessage,
    PlanMessage,
    PrefetchMessage,
    ReadyMessage,
    DegradedMessage,
    SupersededMessage,
    PickedMessage,
    NoticeMessage,
    ErrorMessage,
    JoinedMessage,
    RosterMessage,
    GatheringMessage,
    GatheredMessage>;

}  // namespace terraport
