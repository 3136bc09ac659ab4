#include "LandingState.h"

#include <algorithm>

namespace terraport {

std::optional<double> ringOf(double radiusM, const std::optional<double>& coarseRadiusM, double maxRadiusM) {
  // One below the radius stays: it is a mistake, and is to be told.
  if (!coarseRadiusM || *coarseRadiusM < radiusM) return coarseRadiusM;
  return std::max(radiusM, std::min(*coarseRadiusM, maxRadiusM));
}

LandMessage landMessage(
    std::uint32_t generation, const Vec3& position, double radiusM, const LandOptions& options, double maxRadiusM) {
  LandMessage land;
  land.generation = generation;
  land.position = position;
  land.radiusM = radiusM;
  land.coarseRadiusM = ringOf(radiusM, options.coarseRadiusM, maxRadiusM);
  land.innerRadiusM = options.innerRadiusM;
  land.deadlineMs = options.deadlineMs;
  land.stallMs = options.stallMs;
  return land;
}

LandMessage LandingState::message(std::uint32_t asGeneration, double maxRadiusM) const {
  return landMessage(asGeneration, position, radiusM, options, maxRadiusM);
}

void LandingState::begin(const PlanMessage& plan) {
  facts.clear();
  waiting.clear();
  for (const SegmentFacts& entry : plan.load) {
    facts[entry.segment] = entry;
    waiting.insert(entry.segment);
  }
  planned = waiting;
  planned.insert(plan.keep.begin(), plan.keep.end());
  missing.clear();
  rejects.clear();
  inner.reset();
  isReadySeen = false;
}

void LandingState::expectAgain(const SegmentFacts& segment) {
  waiting.insert(segment.segment);
  facts[segment.segment] = segment;
}

bool LandingState::isComplete() const {
  return isReadySeen && std::includes(missing.begin(), missing.end(), waiting.begin(), waiting.end());
}

std::vector<std::uint32_t> LandingState::shown() const {
  std::vector<std::uint32_t> received;
  std::set_difference(planned.begin(), planned.end(), waiting.begin(), waiting.end(), std::back_inserter(received));
  return received;
}

PrefetchState prefetchState(const PrefetchMessage& prefetch) {
  PrefetchState state;
  state.generation = prefetch.generation;
  state.bytes = prefetch.bytes;
  for (const SegmentFacts& entry : prefetch.segments) {
    state.facts[entry.segment] = entry;
    state.waiting.insert(entry.segment);
  }
  return state;
}

}  // namespace terraport
