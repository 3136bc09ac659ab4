// State of one session: messages and commands in, events and messages to send out (spec/protocol.md). No I/O, no clock.
//
// The service keeps no table of what the client has: every `land` names it. What a landing named or received stays in memory
// until the landing is shown.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <unordered_map>
#include <unordered_set>
#include <variant>
#include <vector>

#include "Core/Cache.h"
#include "Core/Extras/Seat.h"
#include "Core/Messages.h"

namespace terraport {

using KeySet = std::unordered_set<Key>;

/// One bit for each base face, the lowest bit first.
using FaceBits = Bytes;

// ---- events

/// The service said welcome.
struct Opened {
  SceneFacts scene;
  Limits limits;
  /// An earlier connection served another version: nothing is shown until the next landing.
  bool versionChanged = false;
};

/// A landing has its plan; asked for again, it gets another one.
struct Planned {
  std::int64_t landing = 0;
  Plan plan;
  Place place;
};

/// All bytes of a segment came. The caller decodes them and answers with `Session::decoded` or `damaged`.
struct SegmentCame {
  Key key = 0;
  SharedBytes payload;
};

/// The plan needs a segment that only the disk has. The caller answers with `Session::decoded` or `lost`.
struct RestoreNeeded {
  Key key = 0;
  Box box;
};

/// A segment came damaged, or the disk has lost it; the landing asks for it again.
struct SegmentRejected {
  Key key = 0;
};

/// The inner set is complete, and the landing was told that this is enough.
struct InnerComplete {
  std::int64_t landing = 0;
  std::vector<SegmentRow> rows;
  FaceBits hidden;
};

/// The landing is complete: exactly this is shown from now on.
struct Complete {
  std::int64_t landing = 0;
  std::vector<SegmentRow> rows;
  FaceBits hidden;
  /// Segments that could not be delivered.
  std::size_t missing = 0;
  /// Payload bytes that came for it.
  std::uint64_t payloadBytes = 0;
};

/// An unfinished landing was ended by a newer one.
struct Superseded {
  std::int64_t landing = 0;
  std::int64_t by = 0;
};

/// The service refused one landing, or (fatal) the connection; or a landing was given up (`damaged`): too many of its segments
/// cannot be decoded.
struct Refused {
  std::int64_t landing = 0;
  std::string code, message;
  bool isFatal = false;
};

struct PickRefused {
  std::uint32_t request = 0;
  std::string code, message;
};

using Event = std::variant<Opened, Planned, SegmentCame, RestoreNeeded, SegmentRejected, InnerComplete, Complete, Superseded,
    Refused, Picked, PickRefused, Notice, GroupEvent>;

// ---- the session

struct SessionOptions {
  std::string client;
  Budgets budgets;
  std::uint64_t creditBytes = std::uint64_t{16} << 20;
  std::uint64_t cacheBytes = std::uint64_t{256} << 20;
};

struct SessionCounts {
  /// Bytes of payload that came, over all connections.
  std::uint64_t payloadBytes = 0;
  /// Of these, bytes of segments that were in memory already; 0 with a right service.
  std::uint64_t repeatedBytes = 0;
};

/// Outlives connections. One thread.
class Session {
 public:
  /// `onDisk`: what the disk cache has.
  Session(SessionOptions options, std::map<Key, Box> onDisk);

  // Output.
  std::vector<Event> takeEvents() { return std::exchange(events_, {}); }
  /// The messages to send, once. The `land` is made here, of what is held now: however often the user lands before the caller
  /// can send, one goes out.
  std::vector<Bytes> takeMessages();

  // Connection.
  void connected();
  void connectionLost();
  /// Take one whole WebSocket message. A failure: the service broke the protocol, and the connection is closed with 4400.
  Status receive(ByteSpan bytes);

  // Commands. Numbers that the protocol does not allow are refused with -1.
  /// The landing's number in the events, the same over generations.
  std::int64_t land(const Place& place);
  /// Ask once more for the landing that was complete last, as after a change of version; no-op while another one is open.
  void landAgain();
  /// The inner set is enough for that landing from now on.
  void hurry(std::int64_t landing);
  /// Where the user points; the newest is kept until `flushAim`.
  bool aim(const Place& place);
  bool hasAim() const { return aim_.has_value() && isOpen_; }
  void flushAim();
  std::int64_t pick(const Vec3& origin, const std::optional<Vec3>& direction);
  void bye();
  Seat& seat() { return seat_; }

  // Answers to SegmentCame and RestoreNeeded.
  void decoded(Key key, const Box& box, SharedBytes payload);
  void damaged(Key key);
  void lost(Key key);
  /// A segment that was written to disk, and those that were deleted for it.
  void diskChanged(const std::optional<CachedSegment>& stored, const Keys& removed);

  // State.
  bool isOpen() const { return isOpen_; }
  bool isLanding() const { return !open_.empty(); }
  /// Whether the service owes an answer.
  bool awaitsAnswer() const;
  const std::string& version() const { return version_; }
  const std::vector<SegmentRow>& shownRows() const { return shownRows_; }
  const FaceBits& shownHidden() const { return shownHidden_; }
  const CachedSegment* cached(Key key) const { return cache_.find(key); }
  std::uint64_t cacheBytes() const { return cache_.bytes(); }
  const SessionCounts& counts() const { return counts_; }

 private:
  struct Landing {
    std::int64_t number = 0;
    Place wanted;
    /// The inner set is enough: the deadline has passed.
    bool isUrgent = false;
    /// Of the message that was sent last; 0 while it waits to be sent.
    std::uint32_t generation = 0;
    std::optional<Plan> plan;
    std::optional<Ready> ready;
    FaceBits hidden;
    /// Keys of the plan that are neither decoded nor missing.
    KeySet waiting;
    /// Until the plan comes: keys that `have` named, and those that came since.
    KeySet named;
    /// Number of failed deliveries by key, and the keys that are left out for it.
    std::unordered_map<Key, int> failures;
    KeySet givenUp;
    std::uint64_t payloadBytes = 0;
  };

  Status onMessage(const Message& message);
  Status onWelcome(const Welcome& welcome);
  void onError(const Error& error);
  Status onPlan(Plan plan);
  Status onReady(const Ready& ready);
  Status onFrame(const Frame& frame);
  Status takeCredit(std::size_t bytes);
  Status landingOf(std::uint32_t generation, const char* type, Landing*& out);
  void noteArrival(Key key);
  void update();
  void retry(Landing& landing);
  void askAgain(Landing& landing);
  void endBeforeNewest(const Landing& newest);
  Land messageOf(const Place& place, bool isPrefetch);
  std::vector<SegmentRow> rowsOf(const Landing& landing, std::size_t count) const;
  void trim();
  Status inflateBits(const Bytes& packed, FaceBits& out) const;
  std::uint32_t takeRequest() { return ++requests_; }

  const SessionOptions options_;
  SegmentCache cache_;
  std::map<Key, Box> disk_;
  /// Payloads that came and are not decoded yet; null for those that are being read from disk.
  std::map<Key, SharedBytes> decoding_;
  std::vector<Event> events_;
  std::vector<Bytes> outbox_;
  /// Credit that waits to be sent, and its place in the outbox.
  std::uint64_t dueCredit_ = 0;
  std::size_t creditAt_ = 0;
  bool isOpen_ = false;
  bool isGreeting_ = false;
  std::uint32_t generation_ = 0;
  std::int64_t landings_ = 0;
  std::uint32_t requests_ = 0;
  /// Landings that are neither shown nor over, oldest first. The last one alone may be shown; the others go on if the service
  /// refuses it.
  std::vector<Landing> open_;
  /// Number and place of the landing that was complete last.
  std::optional<Landing> complete_;
  std::optional<Place> aim_;
  std::map<std::uint32_t, Pick> picks_;
  /// What has come of the segment that is under way.
  std::shared_ptr<Bytes> part_;
  Key partKey_ = 0;
  std::uint32_t partTotal_ = 0;
  std::uint64_t takenBytes_ = 0, grantedBytes_ = 0, acknowledgedBytes_ = 0, creditStep_ = 1;
  double maxRadiusM_ = kMaxRadiusM;
  std::uint32_t baseFaces_ = 0;
  std::string version_;
  std::vector<SegmentRow> shownRows_;
  KeySet shownKeys_;
  FaceBits shownHidden_;
  SessionCounts counts_;
  Seat seat_;
};

}  // namespace terraport
