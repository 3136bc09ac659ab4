#include "SessionPicks.h"

namespace terraport {

namespace {

PickHit hitOf(const HitPart& part) {
  PickHit hit;
  hit.position = part.position;
  hit.normal = part.normal;
  hit.segment = part.segment;
  hit.region = part.region;
  hit.stableId = part.stableId;
  hit.label = part.label;
  hit.heightM = part.heightM;
  for (const NamedNumber& number : part.attributes) hit.attributes[number.name] = number.value;
  return hit;
}

}  // namespace

PickMessage PickState::ask(std::uint32_t request, const Vec3& origin, const std::optional<Vec3>& direction) {
  PickMessage pick;
  pick.request = request;
  pick.origin = origin;
  pick.direction = direction;
  asked_[request] = pick;
  return pick;
}

std::vector<PickMessage> PickState::waiting() const {
  std::vector<PickMessage> picks;
  for (const auto& asked : asked_) picks.push_back(asked.second);
  return picks;
}

std::vector<std::uint32_t> PickState::dropAll() {
  std::vector<std::uint32_t> requests;
  for (const auto& asked : asked_) requests.push_back(asked.first);
  asked_.clear();
  return requests;
}

void PickState::answered(const PickedMessage& picked) {
  if (asked_.erase(picked.request) == 0) return;
  SessionEvent event;
  event.told.kind = EventKind::Picked;
  event.told.request = picked.request;
  if (picked.hit) event.told.hit = hitOf(*picked.hit);
  events_.push_back(std::move(event));
}

bool PickState::refused(const ErrorMessage& error) {
  if (!error.request || asked_.erase(*error.request) == 0) return false;
  SessionEvent event;
  event.told.kind = EventKind::PickRefused;
  event.told.request = *error.request;
  event.told.code = error.code;
  event.told.message = error.message;
  events_.push_back(std::move(event));
  return true;
}

}  // namespace terraport
