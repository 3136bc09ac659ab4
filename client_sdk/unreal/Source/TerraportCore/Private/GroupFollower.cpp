#include "Terraport/GroupFollower.h"

#include <algorithm>

namespace terraport {

Result<std::uint64_t> GroupFollower::join(const std::string& group, GroupRole role, const std::string& ownName) {
  Result<std::uint64_t> request = stream_.joinGroup(group, role, ownName);
  if (request.isOk()) forget();
  return request;
}

void GroupFollower::leave() {
  stream_.leaveGroup();
  forget();
}

std::int64_t GroupFollower::goThere(double nowMs) {
  if (!group_ || group_->gathering.number == 0) return kNoLanding;
  const GroupGathering& there = group_->gathering;
  LandOptions options;
  if (there.innerRadiusM) {
    options.innerRadiusM = there.innerRadiusM;
    // Less is no deadline that the protocol allows.
    options.deadlineMs = std::max<std::uint32_t>(1, there.leftMs.value_or(1));
  }
  landing_ = lander_ ? lander_(there) : kNoLanding;
  if (landing_ == kNoLanding) landing_ = stage_.land(there.position, there.radiusM, options, nowMs);
  gathering_ = there.number;
  isDegradedTold_ = false;
  return landing_;
}

void GroupFollower::handle(const StreamEvent& event, double nowMs) {
  if (event.kind < EventKind::GroupJoined || event.kind > EventKind::GroupRefused) return;
  group_ = event.group;
  if (!group_) forget();
  if (event.kind != EventKind::GroupCalled) return;
  gathering_ = 0;
  if (follows_) {
    goThere(nowMs);
  } else {
    stream_.arrive(group_->gathering.number, GroupArrival::Declined);
  }
}

void GroupFollower::update() {
  if (gathering_ == 0) return;
  const LandingStatus status = stage_.status();
  const bool isOurs = status.landing == landing_;
  const bool isInner = status.phase == LandingPhase::PresentableDegraded || status.phase == LandingPhase::ShownDegraded;
  if (isOurs && isInner && !isDegradedTold_) {
    isDegradedTold_ = true;
    stream_.arrive(gathering_, GroupArrival::Degraded);
  }
  const bool isThere = status.phase == LandingPhase::Presentable || status.phase == LandingPhase::Shown;
  // A newer landing: its user went elsewhere.
  const bool isOff = !isOurs || status.phase == LandingPhase::Refused;
  if (!isOff && !isThere) return;
  stream_.arrive(gathering_, isOff ? GroupArrival::Declined : GroupArrival::Ready);
  gathering_ = 0;
}

void GroupFollower::forget() {
  group_.reset();
  gathering_ = 0;
}

}  // namespace terraport
