// The server's half of the wire protocol, as short as its rules allow: what the client's state machine is tested against.
// Section numbers are those of `spec/wire-protocol.md`.
#pragma once

#include "WireCodec.h"
#include "session_toy.h"

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace terraport::testing {

struct ModelOptions {
  std::uint32_t maxHeldSegments = 1000;
  bool refusesPicks = false;
  int maxChunk = 131048;
  std::function<double()> random = [] { return 0.999; };
};

/// One connection. What a client must not do is a failed test.
class ModelServer {
 public:
  ModelServer(const ToyScene& scene, ModelOptions options) : scene_(scene), options_(std::move(options)) {}

  std::map<std::uint32_t, std::uint64_t> held;
  std::uint64_t credit = 0;
  /// Chunk bytes sent.
  std::uint64_t chunkBytes = 0;
  /// Everything that the client said, in order.
  std::vector<ClientMessage> heard;
  bool isDeadlinePassed = false;
  /// Whether a landing that comes now waits for its plan, until a newer one ends it (6.3).
  bool plansNothing = false;
  /// Ids that cannot be read whole.
  std::set<std::uint32_t> unreadable;

  void say(ServerMessage message) { out_.push_back(std::move(message)); }

  void receive(const EncodedMessage& data);

  /// The next WebSocket message; absent where nothing can be sent now.
  std::optional<EncodedMessage> next();

  /// Types of what was heard, for comparing.
  std::vector<std::string> heardTypes() const;

 private:
  /// A generation on its way: a landing, or what an aim brings.
  struct Sending {
    std::uint32_t generation = 0;
    bool isLanding = false;
    std::vector<std::uint32_t> order;
    std::vector<std::uint32_t> inner;
    /// What is still to be sent, in order.
    std::vector<std::uint32_t> queue;
    std::set<std::uint32_t> load;
    std::set<std::uint32_t> rejected;
    std::set<std::uint32_t> missing;
    std::uint32_t delivered = 0;
    std::uint64_t payloadBytes = 0;
    bool isReadySent = false;
    bool isDegradedSent = false;
  };

  void on(const UnknownMessage&);
  void on(const HelloMessage& hello);
  void on(const HeldMessage& more);
  void on(const CreditMessage& more) { credit += more.bytes; }
  void on(const EvictMessage& evict);
  void on(const RejectMessage& reject);
  void on(const PickMessage& pick);
  void on(const LandMessage& land);
  void on(const AimMessage& aim);
  void on(const ByeMessage&) {}
  void on(const JoinMessage&) {}
  void on(const LeaveMessage&) {}
  void on(const GatherMessage&) {}
  void on(const ArrivedMessage&) {}

  EncodedMessage encoded(const ServerMessage& message) const;
  std::optional<EncodedMessage> nextMessage();
  std::vector<std::uint32_t> accepted(const std::vector<HeldRow>& rows);
  void startAim();
  std::shared_ptr<Sending> begin(std::uint32_t generation, std::vector<std::uint32_t> order);
  void supersede(const std::shared_ptr<Sending>& sending, std::uint32_t by);
  void supersedeAim(std::uint32_t by);
  void supersedeUnplanned(std::uint32_t by);
  std::vector<std::uint32_t> ordered(const Vec3& centre, double radiusM) const;
  std::vector<std::uint32_t> within(const std::vector<std::uint32_t>& order, std::optional<std::string>& omittedBy) const;
  std::vector<SegmentFacts> rowsOf(const std::vector<std::uint32_t>& ids) const;
  std::optional<EncodedMessage> chunk(Sending& sending);
  void degrade(Sending& sending);
  void settle(const std::shared_ptr<Sending>& sending);
  void expectNewer(std::uint32_t generation);

  const ToyScene& scene_;
  ModelOptions options_;
  std::deque<ServerMessage> out_;
  MessageReader reader_;
  bool isOpen_ = false;
  bool isMoved_ = false;
  BudgetsPart budgets_;
  double releaseFactor_ = 1;
  std::int64_t generation_ = -1;
  std::shared_ptr<Sending> landing_;
  std::optional<std::uint32_t> unplanned_;
  std::shared_ptr<Sending> prefetch_;
  std::optional<AimMessage> waitingAim_;
  std::map<std::uint32_t, std::size_t> sentBytes_;
};

}  // namespace terraport::testing
