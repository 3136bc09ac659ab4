// Membership of a session in a group, over all of its connections (spec/protocol.md, section 10). No I/O, no clock.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "Core/Messages.h"

namespace terraport {

/// The service, or this client, refused a join or a gather.
struct GroupRefused {
  std::uint32_t request = 0;
  std::string code, message;
};

using GroupEvent = std::variant<Joined, Roster, Gathering, Gathered, GroupRefused>;

class Seat {
 public:
  struct Context {
    /// Takes messages to send; called only while the connection is open.
    std::function<void(Bytes)> send;
    std::function<void(GroupEvent)> report;
    std::function<bool()> isOpen;
    std::function<std::uint32_t()> takeRequest;
  };

  explicit Seat(Context context) : context_(std::move(context)) {}

  /// Whether a group and a member may be called that.
  static bool areNames(const std::string& group, const std::string& name);

  /// Ask for a seat; the one held before is left. Returns the request's number in the events, 0 where a name is not allowed.
  std::uint32_t join(const std::string& group, bool isGuide, const std::string& name);
  void leave();
  /// Land the group, now or as soon as the seat is taken again. 0 where a number is not allowed.
  std::uint32_t gather(const Vec3& position, double radiusM);
  /// This member's part is over; told again where a lost connection cut it off.
  void arrived(std::uint32_t gathering, Arrival state);

  /// Take the seat again on a connection that is open; `groups` is what its limits say.
  void connected(const std::string& groups);
  void connectionLost() { isSeated_ = false; }
  /// Take an error; whether it was one of a group's requests.
  bool refused(const Error& error);
  /// Take a message of the group; one that crossed a leave is skipped.
  void receive(const Message& message);

 private:
  void onJoined(const Joined& joined);
  void onGathering(const Gathering& message);
  void reset();

  Context context_;
  std::optional<Join> join_;
  bool isSeated_ = false;
  std::map<std::uint32_t, Gather> gathers_;
  std::uint32_t newest_ = 0;
  std::optional<Arrived> arrived_;
};

}  // namespace terraport
