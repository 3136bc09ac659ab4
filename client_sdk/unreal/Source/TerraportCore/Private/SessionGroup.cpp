#include "SessionGroup.h"

#include <algorithm>
#include <utility>

namespace terraport {

namespace {

/// Gathers that wait for an answer; beyond it the oldest is refused here.
constexpr std::size_t kMaxGathers = 16;

GroupRole roleOf(const std::string& role) {
  return role == "guide" ? GroupRole::Guide : GroupRole::Member;
}

}  // namespace

void GroupState::join(const JoinMessage& join, bool isOpen) {
  // Also where the new seat is refused: the caller has given the old one up.
  leave(isOpen);
  join_ = join;
  if (isOpen) outbox_.emplace_back(join);
}

void GroupState::leave(bool isOpen) {
  if (join_ && isOpen) outbox_.emplace_back(LeaveMessage{});
  reset();
}

void GroupState::gather(const GatherMessage& gather) {
  gathers_.push_back(gather);
  if (gathers_.size() > kMaxGathers) {
    const std::uint32_t oldest = gathers_.front().request;
    gathers_.erase(gathers_.begin());
    refuse(oldest, "too_many", std::to_string(kMaxGathers) + " gathers wait for an answer already");
  }
  if (isSeated_) outbox_.emplace_back(gather);
}

void GroupState::arrive(const ArrivedMessage& arrived) {
  // A newer one has come: nobody waits for this one.
  if (arrived.gathering != newest_) return;
  arrived_ = arrived;
  if (isSeated_) outbox_.emplace_back(arrived);
}

void GroupState::connected(const std::optional<std::string>& groupsServed) {
  if (!join_) return;
  if (groupsServed == "here" || groupsServed == "query") {
    outbox_.emplace_back(*join_);
    return;
  }
  const std::uint32_t request = join_->request;
  reset();
  refuse(request, "group_refused", "no groups are served at this address");
}

bool GroupState::refused(const ErrorMessage& error) {
  if (!error.request) return false;
  const std::uint32_t request = *error.request;
  if (join_ && join_->request == request) {
    reset();
  } else {
    const auto gather = std::find_if(
        gathers_.begin(), gathers_.end(), [request](const GatherMessage& waiting) { return waiting.request == request; });
    if (gather == gathers_.end()) return false;
    gathers_.erase(gather);
  }
  refuse(request, error.code, error.message);
  return true;
}

void GroupState::onMessage(const ServerMessage& message) {
  if (!join_) return;
  if (const auto* const joined = std::get_if<JoinedMessage>(&message)) {
    if (joined->request == join_->request) onJoined(*joined);
    return;
  }
  if (!isSeated_) return;
  if (const auto* const roster = std::get_if<RosterMessage>(&message)) {
    if (roster->group != join_->group) return;
    facts_->members.clear();
    for (const MemberPart& one : roster->members) {
      facts_->members.push_back({one.member, one.name.value_or(""), roleOf(one.role), one.present, one.position});
    }
    report(EventKind::GroupRoster);
  } else if (const auto* const gathering = std::get_if<GatheringMessage>(&message)) {
    onGathering(*gathering);
  } else if (const auto* const gathered = std::get_if<GatheredMessage>(&message)) {
    if (gathered->gathering != newest_) return;
    facts_->gathering.isOver = true;
    facts_->gathering.leftMs.reset();
    facts_->gathering.ready = gathered->ready;
    facts_->gathering.degraded = gathered->degraded;
    facts_->gathering.missing = gathered->missing;
    report(EventKind::GroupGathered);
  }
}

void GroupState::onJoined(const JoinedMessage& joined) {
  isSeated_ = true;
  if (join_->seat != joined.seat) {
    // A new seat, perhaps on a new server: its gatherings count from 1 again.
    newest_ = 0;
    arrived_.reset();
    facts_ = GroupFacts();
    facts_->name = joined.group;
    facts_->member = joined.member;
    facts_->role = roleOf(joined.role);
  }
  join_->seat = joined.seat;
  report(EventKind::GroupJoined);
  // What was asked while the connection was away.
  for (const GatherMessage& gather : gathers_) outbox_.emplace_back(gather);
}

void GroupState::onGathering(const GatheringMessage& message) {
  if (message.gathering == newest_) {
    if (arrived_ && message.leftMs) outbox_.emplace_back(*arrived_);
    return;
  }
  // The guide's own request is answered by its gathering: requests are answered in order.
  newest_ = message.gathering;
  arrived_.reset();
  gathers_.clear();
  GroupGathering gathering;
  gathering.number = message.gathering;
  gathering.guide = message.guide;
  gathering.position = message.position;
  gathering.radiusM = message.radiusM;
  gathering.innerRadiusM = message.innerRadiusM;
  gathering.leftMs = message.leftMs;
  gathering.isOver = !message.leftMs;
  facts_->gathering = std::move(gathering);
  report(EventKind::GroupCalled);
}

void GroupState::reset() {
  join_.reset();
  isSeated_ = false;
  gathers_.clear();
  facts_.reset();
  newest_ = 0;
  arrived_.reset();
}

void GroupState::report(EventKind kind) {
  SessionEvent event;
  event.stream.kind = kind;
  event.stream.group = facts_;
  events_.push_back(std::move(event));
}

void GroupState::refuse(std::uint32_t request, const std::string& code, const std::string& message) {
  SessionEvent event;
  event.stream.kind = EventKind::GroupRefused;
  event.stream.group = facts_;
  event.stream.request = request;
  event.stream.code = code;
  event.stream.message = message;
  events_.push_back(std::move(event));
}

}  // namespace terraport
