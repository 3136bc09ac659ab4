#pragma once

#include "Terraport/Api.h"
#include "Terraport/Types.h"

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace terraport {

/// Landing of an event that belongs to none.
constexpr int kNoLanding = 0;

/// Where the connection stands.
enum class LinkPhase : std::uint8_t {
  Connecting,
  Open,
  /// Lost; another attempt follows by itself.
  Waiting,
  /// For good, until `reconnect` is called.
  Closed,
};

/// News of the connection.
struct LinkState {
  LinkPhase phase = LinkPhase::Closed;
  /// Number of the attempt, from 1; `Connecting` and `Waiting`.
  int attempt = 0;
  /// Milliseconds from this event to the next attempt; `Waiting`.
  double retryInMs = 0;
  /// WebSocket close code; `Waiting` and `Closed`.
  int closeCode = 0;
  /// Error code of the wire protocol (section 11), or "closed"; `Waiting` and `Closed`.
  std::string code;
  /// Text for people.
  std::string message;
};

/// The plan of a landing.
struct PlanFacts {
  Vec3 position;
  double radiusM = 0;
  /// Smaller than `radiusM` where a budget cut the plan: full detail reaches so far.
  double effectiveRadiusM = 0;
  /// Segments that are on their way, nearest first.
  std::vector<SegmentFacts> load;
  /// Segments that were held already, ascending.
  std::vector<std::uint32_t> keep;
  /// Shown before, and not wanted any more, ascending.
  std::vector<std::uint32_t> release;
  std::int64_t loadBytes = 0;
  std::int64_t totalBytes = 0;
  std::int64_t totalTriangles = 0;
  std::uint32_t omittedSegments = 0;
  /// The budget that cut the plan (`max_triangles`, `max_bytes`, `max_segments`); empty where none did.
  std::string omittedBy;
};

/// What a pick met.
struct PickHit {
  /// Point of the surface, metres of the scene frame.
  Vec3 position;
  /// Unit normal on the face's front side.
  Vec3 normal;
  std::uint32_t segment = 0;
  /// Region of the face, in this scene version.
  std::uint32_t region = 0;
  /// Number of the region that is the same in every version, where it has one.
  std::optional<std::uint32_t> stableId;
  /// Label of the region when the pick was answered, where it has one; text from people.
  std::optional<std::string> label;
  /// Height in metres in the survey's own vertical reference.
  double heightM = 0;
  /// Survey attributes there, by name.
  std::vector<std::pair<std::string, double>> attributes;
};

/// What a stream tells.
enum class StreamEventKind : std::uint8_t {
  /// `link`.
  Link,
  /// `sceneVersion`, `session`, `changed`, `maxRadiusM`, `heldCount`.
  Opened,
  /// `landing`, `plan`. After a reconnect a landing gets another one.
  Planned,
  /// `landing` (kNoLanding for what an aim brought), `facts`: whole and verified, `payload(facts.segment)` gives it.
  Arrived,
  /// `landing`, `segments`: may be shown, exactly these; the landing goes on.
  Degraded,
  /// `landing`, `segments` (exactly what must be shown, ascending), `missing`, `elapsedMs`, `payloadBytes`.
  Ready,
  /// `landing`, `by`.
  Superseded,
  /// `segmentCount`, `bytes`: an aim is answered, so much is sent ahead.
  Prefetching,
  /// `segmentCount`, `bytes`: all of it is here.
  Prefetched,
  /// `segments`: not held any more, not of the served version, or evicted here. Their payloads cannot be asked for.
  Dropped,
  /// `landing` (kNoLanding for none), `code`, `message`, `fatal`: a landing, an aim or the connection was refused.
  Refused,
  /// `notice`, `sceneVersion` (perhaps empty), `reconnectAfterMs`.
  Notice,
  /// `request`, `hit` (absent where nothing is met).
  Picked,
  /// `request`, `code`, `message`.
  PickRefused,
};

/// One piece of news. Fields that its kind does not name have no meaning. Landing numbers stay the same over reconnects.
struct StreamEvent {
  StreamEventKind kind = StreamEventKind::Link;
  /// Number that `land` returned.
  int landing = kNoLanding;
  LinkState link;
  std::string sceneVersion;
  /// The server's name for the session, for logs.
  std::string session;
  /// The served version is another one than before: base and cover must be loaded anew (wire protocol, 5, rule 4).
  bool changed = false;
  /// Largest radius that the server takes, metres.
  double maxRadiusM = 0;
  /// Offered segments that the server accepted with `hello`.
  std::uint32_t heldCount = 0;
  PlanFacts plan;
  SegmentFacts facts;
  std::vector<std::uint32_t> segments;
  /// Segments that the server could not deliver, ascending; the next landing tries again.
  std::vector<std::uint32_t> missing;
  /// Milliseconds from `land` until every byte was here and verified.
  double elapsedMs = 0;
  /// Chunk bytes that came for the landing, in all its generations.
  std::int64_t payloadBytes = 0;
  /// The landing that ended this one.
  int by = kNoLanding;
  std::uint32_t segmentCount = 0;
  std::int64_t bytes = 0;
  std::string code;
  /// Text for people.
  std::string message;
  bool fatal = false;
  /// Kind of notice: `draining`, `scene_published`, or one of a later version.
  std::string notice;
  std::optional<std::int64_t> reconnectAfterMs;
  /// Number that `pick` returned.
  int request = 0;
  std::optional<PickHit> hit;
};

/// What has been counted since the stream was made.
struct StreamStats {
  /// Chunk bytes taken, over all connections.
  std::int64_t payloadBytes = 0;
  /// Those of them for segments that were held already; 0 with a right server.
  std::int64_t repeatedBytes = 0;
  std::uint32_t heldSegments = 0;
  std::int64_t heldBytes = 0;
  /// Landings that had an aim before them, and those of them with nothing left to load.
  int aimedLandings = 0;
  int aimHits = 0;
  std::int64_t prefetchedBytes = 0;
  /// Of the prefetched bytes, those that the next landing kept.
  std::int64_t usedPrefetchedBytes = 0;
};

}  // namespace terraport
