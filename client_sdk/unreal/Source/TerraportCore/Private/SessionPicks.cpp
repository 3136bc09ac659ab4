#include "SessionPicks.h"

namespace terraport {

namespace {

PickHit hitOf(const HitPart& wireHit) {
  PickHit hit;
  hit.position = wireHit.position;
  hit.normal = wireHit.normal;
  hit.segment = wireHit.segment;
  hit.region = wireHit.region;
  hit.stableId = wireHit.stableId;
  hit.label = wireHit.label;
  hit.heightM = wireHit.heightM;
  for (const NamedNumber& number : wireHit.attributes) hit.attributes[number.name] = number.value;
  return hit;
}

}  // namespace

PickMessage PickState::ask(std::uint32_t request, const Vec3& origin, const std::optional<Vec3>& direction) {
  PickMessage pick;
  pick.request = request;
  pick.origin = origin;
  pick.direction = direction;
  unanswered_[request] = pick;
  return pick;
}

std::vector<PickMessage> PickState::waiting() const {
  std::vector<PickMessage> picks;
  for (const auto& entry : unanswered_) picks.push_back(entry.second);
  return picks;
}

std::vector<std::uint32_t> PickState::dropAll() {
  std::vector<std::uint32_t> requests;
  for (const auto& entry : unanswered_) requests.push_back(entry.first);
  unanswered_.clear();
  return requests;
}

void PickState::answered(const PickedMessage& picked) {
  if (unanswered_.erase(picked.request) == 0) return;
  SessionEvent event;
  event.stream.kind = EventKind::Picked;
  event.stream.request = picked.request;
  if (picked.hit) event.stream.hit = hitOf(*picked.hit);
  events_.push_back(std::move(event));
}

bool PickState::refused(const ErrorMessage& error) {
  if (!error.request || unanswered_.erase(*error.request) == 0) return false;
  SessionEvent event;
  event.stream.kind = EventKind::PickRefused;
  event.stream.request = *error.request;
  event.stream.code = error.code;
  event.stream.message = error.message;
  events_.push_back(std::move(event));
  return true;
}

}  // namespace terraport
