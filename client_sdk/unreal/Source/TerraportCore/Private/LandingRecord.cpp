#include "LandingRecord.h"

namespace terraport {

void LandingRecord::planned(const PlanFacts& plan) {
  hasPlan = true;
  effectiveRadiusM = plan.effectiveRadiusM;
  hasInner_ = hasWhole_ = false;
  expected_ = plan.keep;
  loadBytes_.clear();
  for (const SegmentFacts& facts : plan.load) {
    expected_.push_back(facts.segment);
    loadBytes_[facts.segment] = facts.length;
  }
}

void LandingRecord::arrived(const SegmentFacts& facts) {
  arrived_.insert(facts.segment);
  if (!hasWhole_ && loadBytes_.count(facts.segment) != 0) {
    payloadBytes += facts.length;
  }
}

void LandingRecord::degrade(const SegmentList& segments) {
  inner_ = segments;
  hasInner_ = true;
}

void LandingRecord::ready(
    const SegmentList& visible, const SegmentList& missingSegments, double elapsedMs, std::uint64_t bytes) {
  whole_ = visible;
  hasWhole_ = true;
  missing = missingSegments;
  readyMs = readyMs < 0.0 ? elapsedMs : readyMs;
  payloadBytes = bytes;
}

void LandingRecord::refuse(const std::string& message) {
  isRefused = true;
  refusal = message;
}

void LandingRecord::restart() {
  hasPlan = hasInner_ = hasWhole_ = false;
  missing.clear();
  shown = ShownExtent::Nothing;
  expected_.clear();
  loadBytes_.clear();
  arrived_.clear();
}

const SegmentList* LandingRecord::target() const {
  if (isRefused) {
    return nullptr;
  }
  if (hasWhole_) {
    return &whole_;
  }
  return hasInner_ && shown != ShownExtent::Degraded ? &inner_ : nullptr;
}

}  // namespace terraport
