// Landings and prefetches on their way: plans and frames in, events and answers out. The part of ClientSession that decides
// what is received, held, pinned and shown. Pure. Section numbers are those of `spec/wire-protocol.md`.
#pragma once

#include "Frames.h"
#include "LandingState.h"
#include "SessionAims.h"
#include "SessionAssembly.h"
#include "SessionEvents.h"
#include "SessionHoldings.h"
#include "Terraport/Status.h"
#include "Terraport/StreamOptions.h"

#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <vector>

namespace terraport {

/// XXH3-64 of a payload.
using PayloadHash = std::uint64_t (*)(ByteSpan);

/// What is on its way on one session, over all its connections. What the server sends is checked against what was asked:
/// a Status that is not ok is a violation of the protocol, after which the connection must be closed.
class Transfers {
 public:
  using Landing = std::shared_ptr<LandingState>;

  /// All of these outlive it. `outbox` takes the messages to send, `events` the events, in order.
  Transfers(const Budgets& budgets, Holdings& holdings, PayloadHash hash, std::vector<ClientMessage>& outbox,
      std::vector<SessionEvent>& events)
      : budgets_(budgets), holdings_(holdings), hash_(hash), outbox_(outbox), events_(events) {}

  /// Ids that the last ready landing shows, ascending.
  const std::vector<std::uint32_t>& visible() const { return visible_; }
  /// Chunk bytes taken.
  std::uint64_t payloadBytes() const { return payloadBytes_; }
  /// Those of them that belong to segments which were held already; 0 with a right server.
  std::uint64_t repeatedBytes() const { return repeatedBytes_; }
  /// What aims have brought.
  const AimCounts& aims() const { return aims_; }
  /// Generation of the newest aim of which everything has come.
  const std::optional<std::uint32_t>& aimDone() const { return aimDone_; }
  /// Segments that are partly here.
  std::size_t partialSegments() const { return assembler_.size(); }

  /// The newest landing that is not ready; null where there is none.
  Landing unfinished() const;

  /// Whether a `land` has no plan yet: then nothing may be evicted (6.7, rule 2).
  bool awaitsPlan() const { return !unplanned_.empty(); }

  /// Ids of the plan that is not ready: these must not be evicted (6.7, rule 2).
  std::set<std::uint32_t> openPlan() const;

  /// Note that a landing was sent.
  void landSent(Landing landing) { unplanned_.push_back(std::move(landing)); }

  /// Note that an aim was sent: it may be answered once.
  void aimSent(std::uint32_t generation) { newestAim_ = generation; }

  /// Forget a landing that was never sent; whether it had not ended before.
  bool withdraw(const Landing& landing);

  /// Forget a landing that the server refused; an older one goes on (6.5, rule 5). Null where it was none.
  Landing refused(const std::optional<std::uint32_t>& generation);

  /// Forget partial payloads (10.2); returns the newest landing that is not ready, to ask again.
  Landing connectionLost();

  /// Show nothing: the served version is another one, so the ids mean other segments (5.4).
  void hideAll();

  /// Take the plan of the oldest landing that has none.
  Status onPlan(const PlanMessage& plan);
  /// Take one of the (one or more) `ready` of the present landing (6.4).
  Status onReady(const ReadyMessage& ready);
  /// Pass on the declared inner set, as soon as all of it is here.
  void onDegraded(const DegradedMessage& degraded);
  /// End a landing or a prefetch: no more frames of it come (6.5).
  void onSuperseded(const SupersededMessage& message);
  /// Begin to take what an aim brings.
  Status onPrefetch(const PrefetchMessage& message);
  /// Take one chunk; compare the hash when it was the last one (4, rule 4).
  Status onFrame(const PayloadFrame& frame);

 private:
  Status expectWithinBudgets(std::uint64_t bytes, std::uint64_t triangles, std::size_t segments) const;
  Status askAgain(LandingState& landing, std::uint32_t segment);
  void reject(std::uint32_t generation, const SegmentFacts& facts, const char* reason);
  void reportRejected(std::int64_t landing, const SegmentFacts& facts);
  Status onWrongHash(const PayloadFrame& frame, const SegmentFacts& facts, bool isOfLanding);
  void take(const SegmentFacts& facts, SharedPayload payload, bool isOfLanding);
  void endCurrent(std::int64_t by);
  void degradeIfWhole();
  void finishIfComplete();
  void endPrefetchIfDone();
  void pin();
  void pinAndTrim();
  void trim();

  const Budgets& budgets_;
  Holdings& holdings_;
  PayloadHash hash_;
  std::vector<ClientMessage>& outbox_;
  std::vector<SessionEvent>& events_;
  Assembler assembler_;
  AimCounts aims_;
  std::vector<std::uint32_t> visible_;
  std::uint64_t payloadBytes_ = 0;
  std::uint64_t repeatedBytes_ = 0;
  std::optional<std::uint32_t> aimDone_;
  std::optional<std::uint32_t> newestAim_;
  std::optional<std::uint32_t> answeredAim_;
  /// Sent, and without a plan yet, oldest first.
  std::vector<Landing> unplanned_;
  Landing current_;
  std::optional<PrefetchState> prefetch_;
  /// Shown perhaps, since a deadline passed: the newest declared inner set.
  std::vector<std::uint32_t> inner_;
  /// Kept beside what is shown: of the newest plan (6.6, rule 3).
  std::vector<std::uint32_t> nearby_;
};

}  // namespace terraport
