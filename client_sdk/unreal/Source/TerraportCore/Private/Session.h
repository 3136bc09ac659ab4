// The client's half of the wire protocol as a state machine: WebSocket messages in; events, and messages to send, out.
//
// The shell (Link) owns transports and clocks. It calls connected, receive, connectionLost as the connection lives and dies,
// and land, aim, pick for its user; after each of them it drains takeEvents and takeMessages. Pure: no I/O, no clock.
#pragma once

#include "LandingState.h"
#include "SessionAims.h"
#include "SessionEvents.h"
#include "SessionGroup.h"
#include "SessionHoldings.h"
#include "SessionOffer.h"
#include "SessionPicks.h"
#include "Terraport/Status.h"
#include "Terraport/StreamOptions.h"
#include "Transfers.h"
#include "WireCodec.h"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace terraport {

/// What a session tells the server in `hello`, and what it keeps.
struct SessionOptions {
  /// Name and version of the client, for the server's logs.
  std::string client;
  Budgets budgets;
  /// Payload bytes under way at most. Half of it is granted back at a time: a larger one saves messages, a smaller one bounds
  /// what lies in buffers when a landing is superseded. At least 1.
  std::uint64_t creditBytes = 0;
  /// Release radius / load radius; absent takes the server's.
  std::optional<double> releaseFactor;
  /// Payload bytes kept beside what is pinned.
  std::uint64_t cacheBytes = 0;
};

/// Whether a session can be made of these. Error code: `invalid_field`.
Status checkSessionOptions(const SessionOptions& options);

/// Whether a landing may be asked for so, an aim, a pick, a seat in a group, a landing of it. Error code: `invalid_field`.
Status checkLand(const Vec3& position, double radiusM, const LandOptions& options);
Status checkAim(const Vec3& position, double radiusM, const std::optional<double>& coarseRadiusM);
Status checkPick(const Vec3& origin, const std::optional<Vec3>& direction);
Status checkJoin(const std::string& group, GroupRole role, const std::string& ownName);
Status checkGather(const Vec3& position, double radiusM, const std::optional<double>& innerRadiusM,
    const std::optional<std::uint32_t>& deadlineMs);

/// The state machine. It outlives connections.
class ClientSession {
 public:
  /// `options` must have passed `checkSessionOptions`.
  ClientSession(SessionOptions options, PayloadHash hash);
  ClientSession(const ClientSession&) = delete;
  ClientSession& operator=(const ClientSession&) = delete;

  const SessionOptions& options() const { return options_; }
  /// Scene version of the newest connection; empty before the first welcome.
  const std::string& version() const { return version_; }
  const Holdings& holdings() const { return holdings_; }
  /// Hold a payload of an earlier run, before the first connection offers it.
  void restore(CachedSegment entry) { holdings_.put(std::move(entry)); }
  /// Whether the server has said welcome on the present connection.
  bool isOpen() const { return isOpen_; }
  /// Whether an aim waits for `flushAim`.
  bool hasAim() const { return aim_.isWaiting() && isOpen_; }
  const Transfers& transfers() const { return transfers_; }
  /// Number of the newest landing that is not ready, or kNoLanding.
  std::int64_t unfinished() const;
  /// Picks that wait for an answer.
  std::size_t openPicks() const { return picks_.count(); }
  /// Whether the server owes an answer: to a landing or a pick.
  bool awaitsAnswer() const { return unfinished() != kNoLanding || openPicks() > 0; }

  // ---- output

  /// What has happened since the last call, once.
  std::vector<SessionEvent> takeEvents();

  /// The WebSocket messages to send, once, in order.
  std::vector<EncodedMessage> takeMessages();

  // ---- connection

  /// Open a connection: the first message is `hello` with what is held. `offersHeld` false after a server found the offer too
  /// large: it is made after its welcome, which says how large it may be.
  void connected(bool offersHeld = true);

  /// Note that the connection is gone. The newest landing that is not ready waits for the next connection, and so do the
  /// newest aim after it, picks and the seat in a group. Parts of segments are forgotten (10.2).
  void connectionLost();

  /// Take one whole WebSocket message. Error code: `malformed`, where the server sent what the protocol does not allow; the
  /// connection must be closed with 4400.
  Status receive(ByteSpan data, bool isText);

  // ---- commands

  /// Ask for a landing; it supersedes every one before that is not ready. Returns its number in the events, which stays the
  /// same when a reconnect asks again. What is asked must have passed `checkLand`.
  std::int64_t land(const Vec3& position, double radiusM, const LandOptions& options);

  /// Note where the user points; only the newest is kept until `flushAim`. Must have passed `checkAim`.
  void aim(const Vec3& position, double radiusM, const std::optional<double>& coarseRadiusM = std::nullopt) {
    aim_.note(position, radiusM, coarseRadiusM);
  }

  /// Send the newest aim, if there is one and the connection is open.
  void flushAim();

  /// Ask what lies along a ray; returns the request's number. Must have passed `checkPick`.
  std::uint32_t pick(const Vec3& origin, const std::optional<Vec3>& direction);

  /// Forget all picks: their answers are skipped, a reconnect does not ask again. Returns their numbers.
  std::vector<std::uint32_t> dropPicks() { return picks_.dropAll(); }

  /// Ask for a seat in a group; the one held before is left. Returns the request's number. Must have passed `checkJoin`.
  std::uint32_t join(const std::string& group, GroupRole role, const std::string& ownName);

  /// Give the seat in the group up; nothing where there is none.
  void leave() { group_.leave(isOpen_); }

  /// Land the group, as its guide; returns the request's number. Must have passed `checkGather`.
  std::uint32_t gather(const Vec3& position, double radiusM, const std::optional<double>& innerRadiusM,
      const std::optional<std::uint32_t>& deadlineMs);

  /// Say how this member's part of a group landing ended; nothing where a newer one has come. Error code: `invalid_field`.
  Status arrive(std::uint32_t gathering, GroupArrival how);

  /// End the session politely.
  void bye();

 private:
  Status onMessage(const ServerMessage& message);
  Status onWelcome(const WelcomeMessage& welcome);
  void onDropped(const std::vector<std::uint32_t>& segments);
  void onNotice(const NoticeMessage& notice);
  void onError(const ErrorMessage& error);
  void queue(Transfers::Landing landing);
  void sendLanding(const Transfers::Landing& landing);
  void withdrawUnsent(std::int64_t by);
  void sendEvictions();
  void grant(std::uint64_t receivedBytes);
  void supersede(std::int64_t landing, std::int64_t by);

  const SessionOptions options_;
  std::string version_;
  /// Of the newest connection; nothing is asked of one before its welcome.
  double maxRadiusM_ = 0.0;
  std::vector<SessionEvent> events_;
  std::vector<ClientMessage> outbox_;
  Holdings holdings_;
  Transfers transfers_;
  AimState aim_;
  HeldOffer offer_;
  PickState picks_;
  GroupState group_;
  MessageReader reader_;
  bool isOpen_ = false;
  bool isGreeting_ = false;
  std::uint32_t generation_ = 0;
  std::int64_t landings_ = 0;
  std::uint32_t requests_ = 0;
  /// The landing whose `land` is still in the outbox.
  Transfers::Landing unsent_;
  /// The landing that waits for the next welcome.
  Transfers::Landing queued_;
  std::uint64_t creditStep_ = 1;
  /// Chunk bytes received since the last `credit`.
  std::uint64_t ungrantedBytes_ = 0;
};

}  // namespace terraport
