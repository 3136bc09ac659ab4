#include "session_model.h"

#include "Frames.h"

#include <doctest/doctest.h>

#include <algorithm>

namespace terraport::testing {

namespace {

bool contains(const std::vector<std::uint32_t>& ids, std::uint32_t id) {
  return std::find(ids.begin(), ids.end(), id) != ids.end();
}

}  // namespace

void ModelServer::receive(const EncodedMessage& data) {
  ClientMessage message;
  DecodeError error;
  const bool isRead = reader_.read(data.view(), message, error);
  REQUIRE_MESSAGE(isRead, error.message);
  heard.push_back(message);
  const bool isHello = std::holds_alternative<HelloMessage>(message);
  REQUIRE(isOpen_ != isHello);
  std::visit([this](const auto& typedMessage) { on(typedMessage); }, message);
}

std::optional<EncodedMessage> ModelServer::next() {
  if (auto message = nextMessage()) return message;
  for (const std::shared_ptr<Sending>& sending : {landing_, prefetch_}) {
    if (sending == nullptr || sending->isReadySent) continue;
    degrade(*sending);
    if (auto message = nextMessage()) return message;
    if (auto frame = chunk(*sending)) return frame;
    settle(sending);
    if (auto message = nextMessage()) return message;
    // An aim never disturbs a landing (7, rule 2).
    if (!sending->isReadySent) return std::nullopt;
  }
  return std::nullopt;
}

std::vector<std::string> ModelServer::heardTypes() const {
  std::vector<std::string> types;
  for (const ClientMessage& message : heard) types.emplace_back(typeOf(message));
  return types;
}

EncodedMessage ModelServer::encoded(const ServerMessage& message) const {
  EncodedMessage data;
  const Status status = encodeMessage(message, data);
  REQUIRE_MESSAGE(status.isOk(), status.message());
  return data;
}

std::optional<EncodedMessage> ModelServer::nextMessage() {
  if (out_.empty()) return std::nullopt;
  EncodedMessage data = encoded(out_.front());
  out_.pop_front();
  return data;
}

void ModelServer::on(const UnknownMessage& message) {
  FAIL("the client said " << message.type);
}

void ModelServer::on(const HelloMessage& hello) {
  isOpen_ = true;
  credit = hello.creditBytes;
  budgets_ = hello.budgets;
  releaseFactor_ = hello.releaseFactor.value_or(1.25);
  WelcomeMessage welcome;
  welcome.protocol = kProtocol;
  welcome.server = "model";
  welcome.session = "s";
  welcome.scene.id = "toy";
  welcome.scene.version = scene_.version;
  welcome.scene.name = "toy";
  welcome.scene.segmentCount = static_cast<std::uint32_t>(scene_.facts.size());
  welcome.limits.maxRadiusM = 500;
  welcome.limits.maxMessageBytes = 1 << 20;
  welcome.limits.maxMessagesPerS = 60;
  welcome.limits.maxHeldSegments = options_.maxHeldSegments;
  welcome.limits.maxPlanSegments = 16384;
  welcome.limits.maxCreditBytes = 1 << 26;
  welcome.limits.idleTimeoutS = 60;
  welcome.releaseFactor = releaseFactor_;
  welcome.dropped = accepted(hello.held.value_or(std::vector<HeldRow>()));
  welcome.heldCount = static_cast<std::uint32_t>(held.size());
  say(std::move(welcome));
}

std::vector<std::uint32_t> ModelServer::accepted(const std::vector<HeldRow>& rows) {
  std::vector<std::uint32_t> dropped;
  for (const HeldRow& row : rows) {
    if (row.segment < scene_.facts.size() && scene_.facts[row.segment].xxh3 == row.xxh3) {
      held[row.segment] = row.xxh3;
    } else {
      dropped.push_back(row.segment);
    }
  }
  return dropped;
}

void ModelServer::on(const HeldMessage& more) {
  REQUIRE(!isMoved_);
  REQUIRE(more.segments.size() <= options_.maxHeldSegments);
  HeldCheckedMessage checked;
  checked.dropped = accepted(more.segments);
  checked.heldCount = static_cast<std::uint32_t>(held.size());
  say(std::move(checked));
}

void ModelServer::on(const EvictMessage& evict) {
  for (const std::uint32_t segment : evict.segments) {
    const bool isOfOpenPlan = landing_ != nullptr && !landing_->isReadySent && contains(landing_->order, segment);
    REQUIRE_MESSAGE(!isOfOpenPlan, "evicts a segment of a plan that is not ready (6.7, rule 2)");
    held.erase(segment);
  }
}

void ModelServer::on(const RejectMessage& reject) {
  held.erase(reject.segment);
  const bool isOfLanding = landing_ != nullptr && contains(landing_->order, reject.segment);
  const std::shared_ptr<Sending> sending = isOfLanding ? landing_ : prefetch_;
  if (sending == nullptr || !contains(sending->order, reject.segment)) return;
  if (!sending->isLanding && sending->load.count(reject.segment) == 0) return;
  if (!sending->rejected.insert(reject.segment).second) {
    if (sending->isLanding) {
      sending->missing.insert(reject.segment);
      sending->isReadySent = false;
    }
    return;
  }
  sending->isReadySent = false;
  sending->queue.push_back(reject.segment);
  const auto rank = [this, &sending](std::uint32_t segment) {
    if (sentBytes_.count(segment) != 0) return std::ptrdiff_t{-1};
    return std::find(sending->order.begin(), sending->order.end(), segment) - sending->order.begin();
  };
  std::stable_sort(
      sending->queue.begin(), sending->queue.end(), [&rank](std::uint32_t a, std::uint32_t b) { return rank(a) < rank(b); });
}

void ModelServer::on(const PickMessage& pick) {
  if (options_.refusesPicks) {
    ErrorMessage error;
    error.code = "too_many";
    error.message = "picks";
    error.request = pick.request;
    say(std::move(error));
    return;
  }
  PickedMessage picked;
  picked.request = pick.request;
  picked.hit.emplace();
  picked.hit->normal = {0, 1, 0};
  picked.hit->segment = 3;
  picked.hit->region = 1;
  picked.hit->heightM = 9;
  say(std::move(picked));
}

/// By sections 6.2 to 6.6 of the wire protocol, as plainly as can be: a client is judged by it.
void ModelServer::on(const LandMessage& land) {
  // 1. A landing that is refused changes nothing.
  expectNewer(land.generation);
  if (land.radiusM > 500) {
    ErrorMessage error;
    error.code = "radius_too_large";
    error.message = "too large";
    error.generation = land.generation;
    say(std::move(error));
    return;
  }
  // 2. It supersedes everything before it, a landing without a plan, too.
  supersedeUnplanned(land.generation);
  supersedeAim(land.generation);
  supersede(prefetch_, land.generation);
  supersede(landing_, land.generation);
  isDeadlinePassed = false;
  if (plansNothing) {
    landing_.reset();
    unplanned_ = land.generation;
    return;
  }
  // 3. The wanted segments, nearest first and within the budgets; those beyond the radius are kept nearby.
  const std::vector<std::uint32_t> order = ordered(land.position, land.radiusM);
  PlanMessage plan;
  std::vector<std::uint32_t> wanted = within(order, plan.omittedBy);
  const auto isNear = [this, &land](std::uint32_t segment) {
    return distance(land.position, scene_.facts[segment].bounds) <= land.radiusM;
  };
  const auto near = static_cast<std::size_t>(std::count_if(order.begin(), order.end(), isNear));
  if (wanted.size() > near) {
    plan.nearby.assign(wanted.begin() + static_cast<std::ptrdiff_t>(near), wanted.end());
    std::sort(plan.nearby.begin(), plan.nearby.end());
    wanted.resize(near);
  }
  if (wanted.size() == near) plan.omittedBy.reset();
  // 4. What of them is to be loaded, what is held already, and what the deadline's inner set is.
  prefetch_ = nullptr;
  landing_ = begin(land.generation, wanted);
  landing_->isLanding = true;
  for (const std::uint32_t segment : wanted) {
    if (distance(land.position, scene_.facts[segment].bounds) <= land.innerRadiusM.value_or(-1)) {
      landing_->inner.push_back(segment);
    }
    if (held.count(segment) != 0) plan.keep.push_back(segment);
  }
  // 5. The plan.
  std::sort(plan.keep.begin(), plan.keep.end());
  plan.generation = land.generation;
  plan.position = land.position;
  plan.radiusM = land.radiusM;
  plan.releaseRadiusM = land.radiusM * releaseFactor_;
  plan.effectiveRadiusM =
      wanted.size() == near ? land.radiusM : distance(land.position, scene_.facts[order[wanted.size()]].bounds);
  plan.innerCount = static_cast<std::uint32_t>(landing_->inner.size());
  plan.load = rowsOf(landing_->queue);
  plan.loadBytes = scene_.bytesOf(landing_->queue);
  plan.loadTriangles = 10 * landing_->queue.size();
  plan.totalBytes = scene_.bytesOf(wanted);
  plan.totalTriangles = 10 * wanted.size();
  plan.omittedSegments = static_cast<std::uint32_t>(near - wanted.size());
  say(std::move(plan));
}

void ModelServer::on(const AimMessage& aim) {
  expectNewer(aim.generation);
  supersedeAim(aim.generation);
  waitingAim_ = aim;
  if (landing_ != nullptr && !landing_->isReadySent) return;
  supersede(prefetch_, aim.generation);
  startAim();
}

void ModelServer::startAim() {
  if (!waitingAim_) return;
  const AimMessage aim = *waitingAim_;
  waitingAim_.reset();
  std::optional<std::string> omittedBy;
  prefetch_ = begin(aim.generation, within(ordered(aim.position, aim.radiusM), omittedBy));
  PrefetchMessage message;
  message.generation = aim.generation;
  message.segments = rowsOf(prefetch_->queue);
  message.bytes = scene_.bytesOf(prefetch_->queue);
  say(std::move(message));
}

std::shared_ptr<ModelServer::Sending> ModelServer::begin(std::uint32_t generation, std::vector<std::uint32_t> order) {
  auto sending = std::make_shared<Sending>();
  sending->generation = generation;
  sending->order = std::move(order);
  for (const std::uint32_t segment : sending->order) {
    if (held.count(segment) == 0) sending->queue.push_back(segment);
  }
  sending->load = std::set<std::uint32_t>(sending->queue.begin(), sending->queue.end());
  for (auto partial = sentBytes_.begin(); partial != sentBytes_.end();) {
    partial = sending->load.count(partial->first) != 0 ? std::next(partial) : sentBytes_.erase(partial);
  }
  return sending;
}

void ModelServer::supersedeUnplanned(std::uint32_t by) {
  if (!unplanned_) return;
  SupersededMessage message;
  message.generation = *unplanned_;
  message.by = by;
  say(std::move(message));
  unplanned_.reset();
}

void ModelServer::supersedeAim(std::uint32_t by) {
  if (!waitingAim_) return;
  SupersededMessage message;
  message.generation = waitingAim_->generation;
  message.by = by;
  say(std::move(message));
  waitingAim_.reset();
}

void ModelServer::supersede(const std::shared_ptr<Sending>& sending, std::uint32_t by) {
  if (sending == nullptr || sending->isReadySent) return;
  SupersededMessage message;
  message.generation = sending->generation;
  message.by = by;
  message.unsentBytes = scene_.bytesOf(sending->queue);
  say(std::move(message));
}

/// Candidates in order (6.1).
std::vector<std::uint32_t> ModelServer::ordered(const Vec3& centre, double radiusM) const {
  const auto far = [this, &centre](std::uint32_t segment) { return distance(centre, scene_.facts[segment].bounds); };
  std::vector<std::uint32_t> order;
  for (const SegmentFacts& row : scene_.facts) {
    const double reach = held.count(row.segment) != 0 ? radiusM * releaseFactor_ : radiusM;
    if (far(row.segment) <= reach) order.push_back(row.segment);
  }
  std::stable_sort(order.begin(), order.end(), [&far](std::uint32_t a, std::uint32_t b) { return far(a) < far(b); });
  return order;
}

/// The strict prefix that the budgets allow (6.2).
std::vector<std::uint32_t> ModelServer::within(
    const std::vector<std::uint32_t>& order, std::optional<std::string>& omittedBy) const {
  std::vector<std::uint32_t> wanted;
  std::uint64_t bytes = 0;
  for (const std::uint32_t segment : order) {
    const std::uint64_t count = wanted.size() + 1;
    bytes += scene_.payloads[segment].size();
    if (count > budgets_.maxSegments.value_or(16384)) {
      omittedBy = "max_segments";
    } else if (10 * count > budgets_.maxTriangles.value_or(10 * count)) {
      omittedBy = "max_triangles";
    } else if (bytes > budgets_.maxBytes.value_or(bytes)) {
      omittedBy = "max_bytes";
    }
    if (omittedBy) break;
    wanted.push_back(segment);
  }
  return wanted;
}

std::vector<SegmentFacts> ModelServer::rowsOf(const std::vector<std::uint32_t>& ids) const {
  std::vector<SegmentFacts> rows;
  for (const std::uint32_t segment : ids) rows.push_back(scene_.facts[segment]);
  return rows;
}

std::optional<EncodedMessage> ModelServer::chunk(Sending& sending) {
  while (!sending.queue.empty() && unreadable.count(sending.queue.front()) != 0) {
    sending.missing.insert(sending.queue.front());
    sending.queue.erase(sending.queue.begin());
  }
  if (sending.queue.empty() || credit < 1) return std::nullopt;
  const std::uint32_t segment = sending.queue.front();
  const std::vector<std::uint8_t>& payload = scene_.payloads[segment];
  const std::size_t offset = sentBytes_.count(segment) != 0 ? sentBytes_[segment] : 0;
  const auto random = static_cast<std::uint64_t>(1 + static_cast<int>(options_.random() * options_.maxChunk));
  const auto length = static_cast<std::size_t>(std::min<std::uint64_t>({random, credit, payload.size() - offset}));
  credit -= length;
  chunkBytes += length;
  sending.payloadBytes += length;
  sentBytes_[segment] = offset + length;
  if (offset + length == payload.size()) {
    sentBytes_.erase(segment);
    sending.queue.erase(sending.queue.begin());
    sending.delivered += 1;
    held[segment] = scene_.facts[segment].xxh3;
  }
  PayloadFrame frame;
  frame.generation = sending.generation;
  frame.segment = segment;
  frame.offset = static_cast<std::uint32_t>(offset);
  frame.total = static_cast<std::uint32_t>(payload.size());
  frame.chunk = {payload.data() + offset, length};
  EncodedMessage data;
  REQUIRE(encodeFrame(frame, data.bytes).isOk());
  return data;
}

/// Say `degraded` where the deadline has passed and the inner set is whole.
void ModelServer::degrade(Sending& sending) {
  const bool isWhole = !sending.inner.empty() &&
      std::all_of(
          sending.inner.begin(), sending.inner.end(), [this](std::uint32_t segment) { return held.count(segment) != 0; });
  if (!isDeadlinePassed || sending.isDegradedSent || !isWhole) return;
  sending.isDegradedSent = true;
  DegradedMessage message;
  message.generation = sending.generation;
  message.segments = sending.inner;
  say(std::move(message));
}

/// Say `ready` where everything is sent.
void ModelServer::settle(const std::shared_ptr<Sending>& sending) {
  if (!sending->queue.empty()) return;
  sending->isReadySent = true;
  if (sending->isLanding) {
    ReadyMessage ready;
    ready.generation = sending->generation;
    ready.delivered = sending->delivered;
    ready.payloadBytes = sending->payloadBytes;
    ready.missing.assign(sending->missing.begin(), sending->missing.end());
    say(std::move(ready));
  }
  if (sending == landing_) startAim();
}

void ModelServer::expectNewer(std::uint32_t generation) {
  REQUIRE(static_cast<std::int64_t>(generation) > generation_);
  generation_ = generation;
  isMoved_ = true;
}

}  // namespace terraport::testing
