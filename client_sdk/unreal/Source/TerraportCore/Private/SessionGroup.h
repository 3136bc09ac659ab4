// The seat in a group, over all connections of a session (wire protocol, section 16). Pure.
#pragma once

#include "Messages.generated.h"
#include "SessionEvents.h"
#include "Terraport/Status.h"
#include "Terraport/Types.h"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace terraport {

/// What the session's user wants of groups, and what the server said of it. Messages must have passed `checkMessage`.
class GroupState {
 public:
  GroupState(std::vector<ClientMessage>& outbox, std::vector<SessionEvent>& events) : outbox_(outbox), events_(events) {}

  /// Ask for a seat; the one held before is left.
  void join(const JoinMessage& join, bool isOpen);

  /// Give the seat up.
  void leave(bool isOpen);

  /// Land the group, now or as soon as the seat is taken again.
  void gather(const GatherMessage& gather);

  /// Say that this member's part is over, and again where a lost connection cut it off.
  void arrive(const ArrivedMessage& arrived);

  /// Take the seat again, on a connection that is open.
  void connected(const std::optional<std::string>& groupsServed);

  /// The seat is taken again on the next connection.
  void connectionLost() { isSeated_ = false; }

  /// Take an error; whether it was one of a group's.
  bool refused(const ErrorMessage& error);

  /// Take a message of the group; others are skipped, and what crossed a leave.
  void onMessage(const ServerMessage& message);

 private:
  void onJoined(const JoinedMessage& joined);
  void onGathering(const GatheringMessage& gathering);
  void reset();
  void report(EventKind kind);
  void refuse(std::uint32_t request, const std::string& code, const std::string& message);

  std::vector<ClientMessage>& outbox_;
  std::vector<SessionEvent>& events_;
  /// As each connection is asked for it; absent without a wish for a seat.
  std::optional<JoinMessage> join_;
  bool isSeated_ = false;
  std::optional<GroupFacts> facts_;
  /// That wait for an answer, in the order asked for.
  std::vector<GatherMessage> gathers_;
  /// The newest gathering, and what was said of it.
  std::uint32_t newest_ = 0;
  std::optional<ArrivedMessage> arrived_;
};

}  // namespace terraport
