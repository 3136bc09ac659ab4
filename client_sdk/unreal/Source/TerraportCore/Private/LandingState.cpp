#include "LandingState.h"

#include <algorithm>

namespace terraport {

LandMessage landMessage(std::uint32_t generation, const Vec3& position, double radiusM, const LandOptions& options) {
  LandMessage land;
  land.generation = generation;
  land.position = position;
  land.radiusM = radiusM;
  land.innerRadiusM = options.innerRadiusM;
  land.deadlineMs = options.deadlineMs;
  land.stallMs = options.stallMs;
  return land;
}

LandMessage LandingState::message(std::uint32_t asGeneration) const {
  return landMessage(asGeneration, position, radiusM, options);
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
