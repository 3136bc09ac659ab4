#include "Transfers.h"

#include <algorithm>
#include <string>

namespace terraport {

namespace {

/// A server sends a segment once more after the first reject, and lists it as missing after the second (6.4, rule 4).
constexpr int kMostRejects = 2;

Status violation(std::string text) {
  return Status::failed("malformed", std::move(text));
}

SessionEvent eventOf(EventKind kind, std::int64_t landing) {
  SessionEvent event;
  event.stream.kind = kind;
  event.stream.landing = landing;
  return event;
}

PlanFacts factsOf(std::int64_t landing, const PlanMessage& plan) {
  PlanFacts facts;
  facts.landing = landing;
  facts.position = plan.position;
  facts.radiusM = plan.radiusM;
  // The wire has one number: how far the plan reaches, at whichever level.
  facts.effectiveRadiusM = std::min(plan.effectiveRadiusM, plan.radiusM);
  if (plan.effectiveRadiusM > plan.radiusM) facts.coarseRadiusM = plan.effectiveRadiusM;
  facts.load = plan.load;
  facts.keep = plan.keep;
  facts.nearby = plan.nearby;
  facts.loadBytes = plan.loadBytes;
  facts.totalBytes = plan.totalBytes;
  facts.totalTriangles = plan.totalTriangles;
  facts.omittedSegments = plan.omittedSegments;
  facts.omittedBy = plan.omittedBy.value_or("");
  return facts;
}

}  // namespace

Transfers::Landing Transfers::unfinished() const {
  if (!unplanned_.empty()) return unplanned_.back();
  return current_ != nullptr && !current_->isDone ? current_ : nullptr;
}

std::set<std::uint32_t> Transfers::openPlan() const {
  return current_ != nullptr && !current_->isDone ? current_->planned : std::set<std::uint32_t>();
}

bool Transfers::withdraw(const Landing& landing) {
  const auto at = std::find(unplanned_.begin(), unplanned_.end(), landing);
  if (at == unplanned_.end()) return false;
  unplanned_.erase(at);
  return true;
}

Transfers::Landing Transfers::refused(const std::optional<std::uint32_t>& generation) {
  const auto at = std::find_if(unplanned_.begin(), unplanned_.end(),
      [&generation](const Landing& landing) { return generation.has_value() && landing->generation == generation; });
  if (at == unplanned_.end()) return nullptr;
  Landing landing = *at;
  unplanned_.erase(at);
  pinAndTrim();
  return landing;
}

Transfers::Landing Transfers::connectionLost() {
  assembler_.clear();
  prefetch_.reset();
  aimDone_.reset();
  newestAim_.reset();
  answeredAim_.reset();
  std::vector<Landing> waiting;
  if (current_ != nullptr && !current_->isDone) waiting.push_back(current_);
  waiting.insert(waiting.end(), unplanned_.begin(), unplanned_.end());
  current_.reset();
  unplanned_.clear();
  Landing newest = waiting.empty() ? nullptr : waiting.back();
  for (const Landing& landing : waiting) {
    if (landing == newest) continue;
    SessionEvent event = eventOf(EventKind::Superseded, landing->number);
    event.stream.by = newest->number;
    events_.push_back(std::move(event));
  }
  pin();
  return newest;
}

void Transfers::hideAll() {
  visible_.clear();
  inner_.clear();
  nearby_.clear();
  pinAndTrim();
}

Status Transfers::onPlan(const PlanMessage& plan) {
  if (unplanned_.empty() || unplanned_.front()->generation != plan.generation) {
    return violation("got a plan of generation " + std::to_string(plan.generation) + ", which no landing waits for");
  }
  TERRAPORT_RETURN_IF_ERROR(
      expectWithinBudgets(plan.totalBytes, plan.totalTriangles, plan.load.size() + plan.keep.size() + plan.nearby.size()));
  // A server that does not know the bound says nothing of it.
  if (plan.totalGpuBytes.value_or(0) > budgets_.maxGpuBytes.value_or(plan.totalGpuBytes.value_or(0))) {
    return violation("got more GPU bytes than the budgets of hello allow (6.2)");
  }
  const Landing landing = unplanned_.front();
  unplanned_.erase(unplanned_.begin());
  endCurrent(landing->number);
  current_ = landing;
  prefetch_.reset();
  nearby_ = plan.nearby;
  landing->begin(plan);
  assembler_.keepOnly(landing->facts);
  aims_.planned(plan.keep, !plan.load.empty());
  std::vector<std::uint32_t> lost;
  for (const std::uint32_t segment : plan.keep) {
    if (holdings_.recall(segment)) continue;
    const auto crossed = landing->crossed.find(segment);
    if (crossed == landing->crossed.end()) {
      lost.push_back(segment);
    } else {
      // Rejected already, and on its way again in this generation (6.4, rule 7).
      landing->expectAgain(crossed->second);
      landing->rejects[segment] = 1;
    }
  }
  pinAndTrim();
  SessionEvent event = eventOf(EventKind::Planned, landing->number);
  event.stream.plan = factsOf(landing->number, plan);
  events_.push_back(std::move(event));
  for (const std::uint32_t segment : lost) TERRAPORT_RETURN_IF_ERROR(askAgain(*landing, segment));
  return Status::ok();
}

Status Transfers::onReady(const ReadyMessage& ready) {
  if (current_ == nullptr || current_->generation != ready.generation) {
    return violation("got ready of generation " + std::to_string(ready.generation) + ", which no landing has now");
  }
  current_->isReadySeen = true;
  current_->missing = std::set<std::uint32_t>(ready.missing.begin(), ready.missing.end());
  finishIfComplete();
  return Status::ok();
}

void Transfers::onDegraded(const DegradedMessage& degraded) {
  if (current_ == nullptr || current_->isDone || current_->generation != degraded.generation) return;
  current_->inner = degraded.segments;
  std::sort(current_->inner->begin(), current_->inner->end());
  degradeIfWhole();
}

void Transfers::onSuperseded(const SupersededMessage& message) {
  if (prefetch_ && prefetch_->generation == message.generation) {
    prefetch_.reset();
  } else if (current_ != nullptr && current_->generation == message.generation) {
    endCurrent(unplanned_.empty() ? current_->number : unplanned_.front()->number);
    current_.reset();
  } else if (!unplanned_.empty() && unplanned_.front()->generation == message.generation) {
    // It ended before anybody planned it: no plan comes (6.3).
    SessionEvent event = eventOf(EventKind::Superseded, unplanned_.front()->number);
    unplanned_.erase(unplanned_.begin());
    event.stream.by = unplanned_.empty() ? event.stream.landing : unplanned_.front()->number;
    events_.push_back(std::move(event));
  }
}

Status Transfers::onPrefetch(const PrefetchMessage& message) {
  // Once for each aim: else a server could go on for ever while it owes a plan, and nothing may be evicted.
  const bool isNew = !answeredAim_ || message.generation > *answeredAim_;
  if (!newestAim_ || message.generation > *newestAim_ || !isNew) {
    return violation("got a prefetch of generation " + std::to_string(message.generation) + ", which no aim has");
  }
  TERRAPORT_RETURN_IF_ERROR(expectWithinBudgets(message.bytes, 0, message.segments.size()));
  answeredAim_ = message.generation;
  prefetch_ = prefetchState(message);
  aims_.prefetching();
  assembler_.keepOnly(prefetch_->facts);
  SessionEvent event = eventOf(EventKind::Prefetching, kNoLanding);
  event.stream.segmentCount = message.segments.size();
  event.stream.payloadBytes = message.bytes;
  events_.push_back(std::move(event));
  endPrefetchIfDone();
  return Status::ok();
}

Status Transfers::onFrame(const PayloadFrame& frame) {
  const bool isOfLanding = current_ != nullptr && current_->generation == frame.generation;
  const bool isOfPrefetch = prefetch_.has_value() && prefetch_->generation == frame.generation;
  if (!isOfLanding && !isOfPrefetch) {
    return violation("got a frame of generation " + std::to_string(frame.generation) + ", which no landing or aim has now");
  }
  const std::map<std::uint32_t, SegmentFacts>& loads = isOfLanding ? current_->facts : prefetch_->facts;
  const auto load = loads.find(frame.segment);
  if (load == loads.end()) {
    return violation("got segment " + std::to_string(frame.segment) + ", which generation " + std::to_string(frame.generation) +
        " does not load");
  }
  // A copy: what follows may forget the generation.
  const SegmentFacts facts = load->second;
  if (isOfLanding) current_->payloadBytes += frame.chunk.size;
  payloadBytes_ += frame.chunk.size;
  if (holdings_.has(frame.segment)) repeatedBytes_ += frame.chunk.size;
  SharedPayload payload;
  TERRAPORT_RETURN_IF_ERROR(assembler_.take(frame, facts.length, payload));
  if (payload == nullptr) return Status::ok();
  if (hash_({payload->data(), payload->size()}) != facts.xxh3) return onWrongHash(frame, facts, isOfLanding);
  take(facts, std::move(payload), isOfLanding);
  return Status::ok();
}

// ---- private

Status Transfers::expectWithinBudgets(std::uint64_t bytes, std::uint64_t triangles, std::size_t segments) const {
  const bool isBeyond = bytes > budgets_.maxBytes.value_or(bytes) || triangles > budgets_.maxTriangles.value_or(triangles) ||
      segments > budgets_.maxSegments.value_or(segments);
  return isBeyond ? violation("got more segments, triangles or bytes than the budgets of hello allow (6.2)") : Status::ok();
}

/// A whole segment with the right hash.
void Transfers::take(const SegmentFacts& facts, SharedPayload payload, bool isOfLanding) {
  holdings_.put({facts, std::move(payload)});
  SessionEvent event = eventOf(EventKind::Arrived, isOfLanding ? current_->number : kNoLanding);
  event.stream.facts = facts;
  events_.push_back(std::move(event));
  if (!awaitsPlan()) trim();
  if (isOfLanding) {
    current_->waiting.erase(facts.segment);
    degradeIfWhole();
    finishIfComplete();
  } else {
    aims_.arrived(facts.segment, facts.length);
    prefetch_->waiting.erase(facts.segment);
    endPrefetchIfDone();
  }
}

Status Transfers::onWrongHash(const PayloadFrame& frame, const SegmentFacts& facts, bool isOfLanding) {
  int& rejects = isOfLanding ? current_->rejects[facts.segment] : prefetch_->rejects[facts.segment];
  rejects += 1;
  if (rejects > kMostRejects) {
    return violation("got segment " + std::to_string(facts.segment) + " wrong once more than it was asked for");
  }
  const bool isLastTry = rejects == kMostRejects;
  reportRejected(isOfLanding ? current_->number : kNoLanding, facts);
  reject(frame.generation, facts, "hash_mismatch");
  if (isOfLanding) {
    // It was whole before, perhaps, and came once too often.
    if (current_->planned.count(facts.segment) != 0) current_->waiting.insert(facts.segment);
  } else if (isLastTry) {
    // A prefetch is sent once more, then no more (6.4, rule 4).
    prefetch_->waiting.erase(facts.segment);
    endPrefetchIfDone();
  }
  return Status::ok();
}

/// Ask for a segment of `keep` that is not here after all (6.4, rule 4).
Status Transfers::askAgain(LandingState& landing, std::uint32_t segment) {
  const std::optional<SegmentFacts> facts = holdings_.factsOf(segment);
  if (!facts) {
    return violation("the plan keeps segment " + std::to_string(segment) + ", which was never held");
  }
  landing.expectAgain(*facts);
  landing.rejects[segment] = 1;
  reportRejected(landing.number, *facts);
  reject(*landing.generation, *facts, "lost");
  return Status::ok();
}

void Transfers::reportRejected(std::int64_t landing, const SegmentFacts& facts) {
  SessionEvent event;
  event.news = SessionNews::Rejected;
  event.stream.landing = landing;
  event.stream.facts = facts;
  events_.push_back(std::move(event));
}

/// Tell that a segment is not held; for a landing under way that crosses on the wire.
void Transfers::reject(std::uint32_t generation, const SegmentFacts& facts, const char* reason) {
  if (holdings_.has(facts.segment)) {
    // Right bytes were here already, and the server sent others over them: whoever took them must forget them first.
    SessionEvent event = eventOf(EventKind::Dropped, kNoLanding);
    event.stream.segments = {facts.segment};
    events_.push_back(std::move(event));
  }
  holdings_.forget(facts.segment);
  for (const Landing& landing : unplanned_) landing->crossed[facts.segment] = facts;
  RejectMessage message;
  message.generation = generation;
  message.segment = facts.segment;
  message.reason = reason;
  outbox_.emplace_back(std::move(message));
}

void Transfers::endCurrent(std::int64_t by) {
  if (current_ == nullptr || current_->isDone) return;
  SessionEvent event = eventOf(EventKind::Superseded, current_->number);
  event.stream.by = by;
  events_.push_back(std::move(event));
}

void Transfers::degradeIfWhole() {
  LandingState& landing = *current_;
  if (!landing.inner) return;
  const bool isOpen = std::any_of(landing.inner->begin(), landing.inner->end(),
      [&landing](std::uint32_t segment) { return landing.waiting.count(segment) != 0 || landing.planned.count(segment) == 0; });
  if (isOpen) return;
  inner_ = std::move(*landing.inner);
  landing.inner.reset();
  SessionEvent event = eventOf(EventKind::Degraded, landing.number);
  event.stream.segments = inner_;
  events_.push_back(std::move(event));
}

void Transfers::finishIfComplete() {
  if (current_ == nullptr || current_->isDone || !current_->isComplete()) return;
  LandingState& landing = *current_;
  landing.isDone = true;
  visible_ = landing.shown();
  inner_.clear();
  SessionEvent event = eventOf(EventKind::Ready, landing.number);
  event.stream.segments = visible_;
  event.stream.missing.assign(landing.waiting.begin(), landing.waiting.end());
  event.stream.payloadBytes = landing.payloadBytes;
  events_.push_back(std::move(event));
  pinAndTrim();
}

void Transfers::endPrefetchIfDone() {
  if (!prefetch_->waiting.empty()) return;
  aimDone_ = prefetch_->generation;
  SessionEvent event = eventOf(EventKind::Prefetched, kNoLanding);
  event.stream.segmentCount = prefetch_->facts.size();
  event.stream.payloadBytes = prefetch_->bytes;
  events_.push_back(std::move(event));
}

void Transfers::pin() {
  std::set<std::uint32_t> pinned = openPlan();
  pinned.insert(visible_.begin(), visible_.end());
  pinned.insert(inner_.begin(), inner_.end());
  pinned.insert(nearby_.begin(), nearby_.end());
  holdings_.pin(std::move(pinned));
}

void Transfers::pinAndTrim() {
  pin();
  if (!awaitsPlan()) trim();
}

void Transfers::trim() {
  std::vector<std::uint32_t> segments = holdings_.trim();
  if (segments.empty()) return;
  SessionEvent event = eventOf(EventKind::Dropped, kNoLanding);
  event.stream.segments = std::move(segments);
  events_.push_back(std::move(event));
}

}  // namespace terraport
