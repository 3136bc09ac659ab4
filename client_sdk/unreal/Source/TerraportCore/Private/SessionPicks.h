// Picks that wait for an answer, over all connections of a session. Pure.
#pragma once

#include "Messages.generated.h"
#include "SessionEvents.h"

#include <cstdint>
#include <map>
#include <optional>
#include <vector>

namespace terraport {

/// Asked again on the next connection until they are answered, refused or dropped.
class PickState {
 public:
  explicit PickState(std::vector<SessionEvent>& events) : events_(events) {}

  /// How many wait.
  std::size_t count() const { return unanswered_.size(); }

  /// The message that asks what lies along a ray.
  PickMessage ask(std::uint32_t request, const Vec3& origin, const std::optional<Vec3>& direction);

  /// The messages of all that wait, for a new connection.
  std::vector<PickMessage> waiting() const;

  /// Numbers of all that wait; they are forgotten, so that their answers are skipped.
  std::vector<std::uint32_t> dropAll();

  void answered(const PickedMessage& picked);

  /// Take an error; whether it was one of a pick's.
  bool refused(const ErrorMessage& error);

 private:
  std::vector<SessionEvent>& events_;
  std::map<std::uint32_t, PickMessage> unanswered_;
};

}  // namespace terraport
