#include "SessionAims.h"

#include "LandingState.h"

namespace terraport {

void AimCounts::arrived(std::uint32_t segment, std::uint64_t length) {
  prefetchedBytes += length;
  ahead_[segment] = length;
}

void AimCounts::planned(const std::vector<std::uint32_t>& keep, bool loads) {
  if (isAimed_) {
    isAimed_ = false;
    landings += 1;
    if (!loads) hits += 1;
  }
  for (const std::uint32_t segment : keep) {
    const auto ahead = ahead_.find(segment);
    if (ahead != ahead_.end()) usedBytes += ahead->second;
  }
  ahead_.clear();
}

std::optional<AimMessage> AimState::take(std::uint32_t generation, double maxRadiusM) {
  if (!noted_) return std::nullopt;
  sent_ = noted_;
  noted_.reset();
  generation_ = generation;
  AimMessage aim;
  aim.generation = generation;
  aim.position = sent_->position;
  aim.radiusM = sent_->radiusM;
  aim.coarseRadiusM = ringOf(sent_->radiusM, sent_->coarseRadiusM, maxRadiusM);
  return aim;
}

void AimState::clear() {
  noted_.reset();
  sent_.reset();
}

void AimState::refused(const std::optional<std::uint32_t>& generation) {
  if (generation && generation == generation_) sent_.reset();
}

void AimState::connectionLost(const std::optional<std::uint32_t>& done) {
  const bool isWhole = generation_.has_value() && generation_ == done;
  if (!noted_ && !isWhole) noted_ = sent_;
  generation_.reset();
}

}  // namespace terraport
