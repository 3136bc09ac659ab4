#include "Core/Extras/Seat.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace terraport {
namespace {

/// Unanswered gathers at a time; then this client refuses the oldest.
constexpr std::size_t kMaxGathers = 16;
constexpr std::size_t kMaxNameBytes = 64;

}  // namespace

bool Seat::areNames(const std::string& group, const std::string& name) {
  constexpr char kLetters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_.~-";
  return !group.empty() && group.size() <= kMaxNameBytes && name.size() <= kMaxNameBytes &&
      group.find_first_not_of(kLetters) == std::string::npos;
}

std::uint32_t Seat::join(const std::string& group, bool isGuide, const std::string& name) {
  if (!areNames(group, name)) return 0;
  leave();  // Also where the new seat is refused: the caller has given the old one up.
  join_ = Join{context_.takeRequest(), group, isGuide, name, ""};
  if (context_.isOpen()) context_.send(encode(*join_));
  return join_->request;
}

void Seat::leave() {
  if (join_ && context_.isOpen()) context_.send(encodeBare("leave"));
  reset();
}

std::uint32_t Seat::gather(const Vec3& position, double radiusM) {
  const double furthest = std::max({std::fabs(position.x), std::fabs(position.y), std::fabs(position.z)});
  if (!(furthest <= kMaxCoordinateM) || !(radiusM > 0.0) || !(radiusM <= kMaxRadiusM)) return 0;
  const Gather gather{context_.takeRequest(), position, radiusM};
  gathers_[gather.request] = gather;
  if (gathers_.size() > kMaxGathers) {
    const std::uint32_t oldest = gathers_.begin()->first;
    gathers_.erase(oldest);
    context_.report(GroupRefused{oldest, "too_many", std::to_string(kMaxGathers) + " gathers wait for an answer already"});
  }
  if (isSeated_) context_.send(encode(gather));
  return gather.request;
}

void Seat::arrived(std::uint32_t gathering, Arrival state) {
  if (gathering == 0 || gathering != newest_) return;  // A newer one has come: nobody waits for this one.
  arrived_ = Arrived{gathering, state};
  if (isSeated_) context_.send(encode(*arrived_));
}

void Seat::connected(const std::string& groups) {
  if (!join_) return;
  if (groups == "here" || groups == "query") {
    context_.send(encode(*join_));
    return;
  }
  const std::uint32_t request = join_->request;
  reset();
  context_.report(GroupRefused{request, "group_refused", "no groups are served at this address"});
}

bool Seat::refused(const Error& error) {
  if (!error.request) return false;
  if (join_ && *error.request == join_->request) {
    reset();
  } else if (gathers_.erase(*error.request) == 0) {
    return false;
  }
  context_.report(GroupRefused{*error.request, error.code, error.message});
  return true;
}

void Seat::receive(const Message& message) {
  if (!join_) return;
  if (const auto* joined = std::get_if<Joined>(&message)) {
    if (joined->request == join_->request) onJoined(*joined);
  } else if (!isSeated_) {
    return;
  } else if (const auto* roster = std::get_if<Roster>(&message)) {
    if (roster->group == join_->group) context_.report(*roster);
  } else if (const auto* gathering = std::get_if<Gathering>(&message)) {
    onGathering(*gathering);
  } else if (const auto* gathered = std::get_if<Gathered>(&message)) {
    if (gathered->gathering == newest_) context_.report(*gathered);
  }
}

void Seat::onJoined(const Joined& joined) {
  isSeated_ = true;
  if (joined.seat != join_->seat) {
    // A new seat, perhaps on a new server: its gatherings count from 1 again.
    newest_ = 0;
    arrived_.reset();
  }
  join_->seat = joined.seat;
  context_.report(joined);
  // What was asked while the connection was away.
  for (const auto& [request, gather] : gathers_) {
    (void)request;
    context_.send(encode(gather));
  }
}

void Seat::onGathering(const Gathering& message) {
  // The guide's own request is answered by its gathering: requests are answered in order.
  if (message.gathering == newest_) {
    if (arrived_ && message.leftMs) context_.send(encode(*arrived_));
    return;
  }
  newest_ = message.gathering;
  arrived_.reset();
  gathers_.clear();
  context_.report(message);
}

void Seat::reset() {
  join_.reset();
  isSeated_ = false;
  gathers_.clear();
  newest_ = 0;
  arrived_.reset();
}

}  // namespace terraport
