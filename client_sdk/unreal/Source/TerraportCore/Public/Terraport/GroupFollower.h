// The user's part in a group.
#pragma once

#include "Terraport/Api.h"
#include "Terraport/SceneStage.h"
#include "Terraport/SceneStream.h"
#include "Terraport/Types.h"

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>

namespace terraport {

/// Lands where a group's guide lands it, where that is wished, and tells the group how that went. Nobody is moved here: where
/// the user stands is up to whoever listens.
///
/// Not thread-safe: of the stage's thread. Every event goes to `handle` behind the stage's, and `update` is called after the
/// stage's. Stream and stage must outlive it.
class TERRAPORTCORE_API GroupFollower {
 public:
  GroupFollower(ISceneStream& stream, SceneStage& stage) : stream_(stream), stage_(stage) {}

  /// Land where the guide does. Else the group is told that this member does not come, and `goThere` may still be called.
  void setFollows(bool follows) { follows_ = follows; }
  bool follows() const { return follows_; }

  /// Lands there in place of the stage, with a teleport for instance; returns the landing's number, or kNoLanding where it
  /// cannot. Null for the stage.
  void setLander(std::function<std::int64_t(const GroupGathering&)> lander) { lander_ = std::move(lander); }

  /// The group as it is now; absent without a seat.
  const std::optional<GroupFacts>& group() const { return group_; }

  /// As ISceneStream::joinGroup, leaveGroup.
  Result<std::uint64_t> join(const std::string& group, GroupRole role, const std::string& ownName);
  void leave();

  /// Land where the group is, though that was not followed. The landing's number; kNoLanding where the group is nowhere.
  std::int64_t goThere(double nowMs);

  /// Take an event of the stream; every one, in their order. `nowMs` as for SceneStage::land.
  void handle(const StreamEvent& event, double nowMs);

  /// Tell the group once the landing that it asked for can be shown, or comes to nothing.
  void update();

 private:
  void forget();

  ISceneStream& stream_;
  SceneStage& stage_;
  std::optional<GroupFacts> group_;
  bool follows_ = true;
  std::function<std::int64_t(const GroupGathering&)> lander_;
  /// The gathering that is landed for, and its landing; 0 where none is.
  std::uint32_t gathering_ = 0;
  std::int64_t landing_ = kNoLanding;
  bool isDegradedTold_ = false;
};

}  // namespace terraport
