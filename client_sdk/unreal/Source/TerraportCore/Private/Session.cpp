#include "Session.h"

#include "Frames.h"

#include <algorithm>
#include <limits>
#include <utility>

namespace terraport {

namespace {

/// No server has said yet what it allows.
constexpr double kAnyRadiusM = std::numeric_limits<double>::infinity();

HelloMessage helloMessage(const SessionOptions& options, std::vector<HeldRow> rows) {
  HelloMessage hello;
  hello.protocol = kProtocol;
  hello.client = options.client;
  hello.encoding = kPayloadEncoding;
  hello.budgets.maxTriangles = options.budgets.maxTriangles;
  hello.budgets.maxBytes = options.budgets.maxBytes;
  hello.budgets.maxSegments = options.budgets.maxSegments;
  hello.budgets.maxGpuBytes = options.budgets.maxGpuBytes;
  hello.budgets.gpuVertexBytes = options.budgets.gpuVertexBytes;
  hello.budgets.gpuFaceBytes = options.budgets.gpuFaceBytes;
  hello.creditBytes = options.creditBytes;
  hello.releaseFactor = options.releaseFactor;
  hello.held = std::move(rows);
  return hello;
}

JoinMessage joinMessage(std::uint32_t request, const std::string& group, GroupRole role, const std::string& ownName) {
  JoinMessage join;
  join.request = request;
  join.group = group;
  join.role = role == GroupRole::Guide ? "guide" : "member";
  if (!ownName.empty()) join.name = ownName;
  return join;
}

GatherMessage gatherMessage(std::uint32_t request, const Vec3& position, double radiusM,
    const std::optional<double>& innerRadiusM, const std::optional<std::uint32_t>& deadlineMs) {
  GatherMessage gather;
  gather.request = request;
  gather.position = position;
  gather.radiusM = radiusM;
  gather.innerRadiusM = innerRadiusM;
  gather.deadlineMs = deadlineMs;
  return gather;
}

Status malformed(std::string text) {
  return Status::failed("malformed", std::move(text));
}

}  // namespace

Status checkSessionOptions(const SessionOptions& options) {
  if (options.creditBytes < 1) return Status::failed("invalid_field", "credit is 0 bytes, expected 1 or more");
  return checkMessage(helloMessage(options, {}));
}

Status checkLand(const Vec3& position, double radiusM, const LandOptions& options) {
  return checkMessage(landMessage(0, position, radiusM, options, kAnyRadiusM));
}

Status checkAim(const Vec3& position, double radiusM, const std::optional<double>& coarseRadiusM) {
  AimMessage aim;
  aim.position = position;
  aim.radiusM = radiusM;
  aim.coarseRadiusM = coarseRadiusM;
  return checkMessage(aim);
}

Status checkPick(const Vec3& origin, const std::optional<Vec3>& direction) {
  PickMessage pick;
  pick.origin = origin;
  pick.direction = direction;
  return checkMessage(pick);
}

Status checkJoin(const std::string& group, GroupRole role, const std::string& ownName) {
  return checkMessage(joinMessage(0, group, role, ownName));
}

Status checkGather(const Vec3& position, double radiusM, const std::optional<double>& innerRadiusM,
    const std::optional<std::uint32_t>& deadlineMs) {
  return checkMessage(gatherMessage(0, position, radiusM, innerRadiusM, deadlineMs));
}

ClientSession::ClientSession(SessionOptions options, PayloadHash hash)
    : options_(std::move(options)),
      holdings_(options_.cacheBytes),
      transfers_(options_.budgets, holdings_, hash, outbox_, events_),
      picks_(events_),
      group_(outbox_, events_) {}

std::int64_t ClientSession::unfinished() const {
  const Transfers::Landing landing = queued_ != nullptr ? queued_ : transfers_.unfinished();
  return landing == nullptr ? kNoLanding : landing->number;
}

// ---- output

std::vector<SessionEvent> ClientSession::takeEvents() {
  return std::exchange(events_, {});
}

std::vector<EncodedMessage> ClientSession::takeMessages() {
  unsent_.reset();
  std::vector<EncodedMessage> encoded;
  encoded.reserve(outbox_.size());
  for (const ClientMessage& message : outbox_) {
    EncodedMessage encodedMessage;
    // What goes into the outbox was checked before: options and arguments by the functions above, the rest by its types.
    if (encodeMessage(message, encodedMessage).isOk()) encoded.push_back(std::move(encodedMessage));
  }
  outbox_.clear();
  return encoded;
}

// ---- connection

void ClientSession::connected(bool offersHeld) {
  isOpen_ = false;
  isGreeting_ = true;
  outbox_.clear();
  outbox_.emplace_back(helloMessage(options_, offer_.first(holdings_.offer(), offersHeld)));
}

void ClientSession::connectionLost() {
  isOpen_ = false;
  isGreeting_ = false;
  outbox_.clear();
  unsent_.reset();
  ungrantedBytes_ = 0;
  aim_.connectionLost(transfers_.aimDone());
  queue(transfers_.connectionLost());
  group_.connectionLost();
}

Status ClientSession::receive(ByteSpan data, bool isText) {
  if (isText) return malformed("got a text message, expected a binary one");
  DecodeError error;
  if (isPayload(data)) {
    PayloadFrame frame;
    if (!decodeFrame(data, frame, error)) return malformed(error.message);
    if (frame.unknownKind) return Status::ok();
    TERRAPORT_RETURN_IF_ERROR(transfers_.onFrame(frame));
    grant(frame.chunk.size);
    return Status::ok();
  }
  ServerMessage message;
  if (!reader_.read(data, message, error)) return malformed(error.message);
  return onMessage(message);
}

// ---- commands

std::int64_t ClientSession::land(const Vec3& position, double radiusM, const LandOptions& options) {
  auto landing = std::make_shared<LandingState>();
  landings_ += 1;
  landing->number = landings_;
  landing->position = position;
  landing->radiusM = radiusM;
  landing->options = options;
  aim_.clear();
  if (isOpen_) {
    sendLanding(landing);
  } else {
    queue(landing);
  }
  return landing->number;
}

void ClientSession::flushAim() {
  if (!hasAim()) return;
  sendEvictions();
  generation_ += 1;
  if (const std::optional<AimMessage> message = aim_.take(generation_, maxRadiusM_)) {
    outbox_.emplace_back(*message);
    transfers_.aimSent(generation_);
  }
}

std::uint32_t ClientSession::pick(const Vec3& origin, const std::optional<Vec3>& direction) {
  requests_ += 1;
  const PickMessage message = picks_.ask(requests_, origin, direction);
  if (isOpen_) outbox_.emplace_back(message);
  return requests_;
}

std::uint32_t ClientSession::join(const std::string& group, GroupRole role, const std::string& ownName) {
  requests_ += 1;
  group_.join(joinMessage(requests_, group, role, ownName), isOpen_);
  return requests_;
}

std::uint32_t ClientSession::gather(const Vec3& position, double radiusM, const std::optional<double>& innerRadiusM,
    const std::optional<std::uint32_t>& deadlineMs) {
  requests_ += 1;
  group_.gather(gatherMessage(requests_, position, radiusM, innerRadiusM, deadlineMs));
  return requests_;
}

Status ClientSession::arrive(std::uint32_t gathering, GroupArrival how) {
  ArrivedMessage arrived;
  arrived.gathering = gathering;
  arrived.state = how == GroupArrival::Ready ? "ready" : how == GroupArrival::Degraded ? "degraded" : "declined";
  TERRAPORT_RETURN_IF_ERROR(checkMessage(arrived));
  group_.arrive(arrived);
  return Status::ok();
}

void ClientSession::bye() {
  if (isOpen_) outbox_.emplace_back(ByeMessage{});
}

// ---- messages

Status ClientSession::onMessage(const ServerMessage& message) {
  if (std::holds_alternative<UnknownMessage>(message)) return Status::ok();
  if (const auto* const welcome = std::get_if<WelcomeMessage>(&message)) return onWelcome(*welcome);
  if (const auto* const error = std::get_if<ErrorMessage>(&message)) {
    onError(*error);
    return Status::ok();
  }
  if (!isOpen_) return malformed(std::string("got ") + typeOf(message) + " first, expected welcome or error");
  if (const auto* const plan = std::get_if<PlanMessage>(&message)) return transfers_.onPlan(*plan);
  if (const auto* const ready = std::get_if<ReadyMessage>(&message)) return transfers_.onReady(*ready);
  if (const auto* const prefetch = std::get_if<PrefetchMessage>(&message)) return transfers_.onPrefetch(*prefetch);
  if (const auto* const degraded = std::get_if<DegradedMessage>(&message)) transfers_.onDegraded(*degraded);
  if (const auto* const superseded = std::get_if<SupersededMessage>(&message)) transfers_.onSuperseded(*superseded);
  if (const auto* const picked = std::get_if<PickedMessage>(&message)) picks_.answered(*picked);
  if (const auto* const checked = std::get_if<HeldCheckedMessage>(&message)) onDropped(checked->dropped);
  if (const auto* const notice = std::get_if<NoticeMessage>(&message)) onNotice(*notice);
  group_.onMessage(message);
  return Status::ok();
}

Status ClientSession::onWelcome(const WelcomeMessage& welcome) {
  if (isOpen_ || !isGreeting_) return malformed("got a second welcome, expected one");
  if (welcome.protocol.majorNumber != kProtocol.majorNumber) {
    return malformed("got protocol " + std::to_string(welcome.protocol.majorNumber) + "." +
        std::to_string(welcome.protocol.minorNumber) + ", expected 1.x");
  }
  isOpen_ = true;
  isGreeting_ = false;
  const bool isChanged = !version_.empty() && version_ != welcome.scene.version;
  version_ = welcome.scene.version;
  maxRadiusM_ = welcome.limits.maxRadiusM;
  if (isChanged) transfers_.hideAll();
  creditStep_ = std::max<std::uint64_t>(1, std::min(options_.creditBytes, welcome.limits.maxCreditBytes) / 2);
  SessionEvent event;
  event.stream.kind = EventKind::Opened;
  event.stream.sceneVersion = version_;
  event.stream.session = welcome.session;
  event.stream.changed = isChanged;
  event.stream.maxRadiusM = welcome.limits.maxRadiusM;
  event.stream.heldCount = welcome.heldCount;
  event.limits = welcome.limits;
  events_.push_back(std::move(event));
  onDropped(welcome.dropped);
  std::vector<std::uint32_t> untold;
  for (HeldMessage& table : offer_.rest(welcome, untold)) outbox_.emplace_back(std::move(table));
  // A server that takes no table cannot learn of these: what it does not know of is not held (10.2).
  onDropped(untold);
  for (const PickMessage& pick : picks_.waiting()) outbox_.emplace_back(pick);
  group_.connected(welcome.limits.groups);
  if (queued_ != nullptr) sendLanding(std::exchange(queued_, nullptr));
  return Status::ok();
}

/// Free what the server does not count as held.
void ClientSession::onDropped(const std::vector<std::uint32_t>& segments) {
  if (segments.empty()) return;
  for (const std::uint32_t segment : segments) holdings_.forget(segment);
  SessionEvent event;
  event.stream.kind = EventKind::Dropped;
  event.stream.segments = segments;
  events_.push_back(std::move(event));
}

void ClientSession::onNotice(const NoticeMessage& notice) {
  SessionEvent event;
  event.stream.kind = EventKind::Notice;
  event.stream.noticeKind = notice.kind;
  event.stream.sceneVersion = notice.version.value_or("");
  if (notice.reconnectAfterMs) event.stream.reconnectAfterMs = static_cast<double>(*notice.reconnectAfterMs);
  events_.push_back(std::move(event));
}

void ClientSession::onError(const ErrorMessage& error) {
  // A request's own answer: nothing else was refused, unless the connection ends with it.
  const bool isAnswer = picks_.refused(error) || group_.refused(error);
  if (isAnswer && !error.fatal) return;
  aim_.refused(error.generation);
  const Transfers::Landing refused = error.fatal ? nullptr : transfers_.refused(error.generation);
  SessionEvent event;
  event.stream.kind = EventKind::Refused;
  event.stream.landing = refused == nullptr ? kNoLanding : refused->number;
  event.stream.code = error.code;
  event.stream.message = error.message;
  event.stream.fatal = error.fatal;
  events_.push_back(std::move(event));
}

// ---- state

/// Keep the newest landing for the next connection; what waited before is superseded.
void ClientSession::queue(Transfers::Landing landing) {
  if (landing == nullptr) return;
  landing->generation.reset();
  landing->crossed.clear();
  if (queued_ != nullptr) supersede(queued_->number, landing->number);
  queued_ = std::move(landing);
}

void ClientSession::sendLanding(const Transfers::Landing& landing) {
  withdrawUnsent(landing->number);
  sendEvictions();
  generation_ += 1;
  landing->generation = generation_;
  transfers_.landSent(landing);
  outbox_.emplace_back(landing->message(generation_, maxRadiusM_));
  unsent_ = landing;
}

/// Replace a landing that never left: however often the user lands, one `land` waits to be sent.
void ClientSession::withdrawUnsent(std::int64_t by) {
  if (unsent_ == nullptr) return;
  outbox_.erase(std::remove_if(outbox_.begin(), outbox_.end(),
                    [](const ClientMessage& message) { return std::holds_alternative<LandMessage>(message); }),
      outbox_.end());
  if (transfers_.withdraw(unsent_)) supersede(unsent_->number, by);
  unsent_.reset();
}

void ClientSession::sendEvictions() {
  // What may not be evicted now (6.7, rule 2) is named before the next land or aim.
  if (transfers_.awaitsPlan()) return;
  for (ClientMessage& evict : holdings_.evictions(transfers_.openPlan())) outbox_.push_back(std::move(evict));
}

void ClientSession::grant(std::uint64_t receivedBytes) {
  ungrantedBytes_ += receivedBytes;
  if (ungrantedBytes_ < creditStep_) return;
  // Beside one that was not sent yet it makes one message: what waits to be sent must not grow with what comes.
  for (ClientMessage& waiting : outbox_) {
    if (auto* const credit = std::get_if<CreditMessage>(&waiting)) {
      credit->bytes += std::exchange(ungrantedBytes_, 0);
      return;
    }
  }
  CreditMessage credit;
  credit.bytes = std::exchange(ungrantedBytes_, 0);
  outbox_.emplace_back(credit);
}

void ClientSession::supersede(std::int64_t landing, std::int64_t by) {
  SessionEvent event;
  event.stream.kind = EventKind::Superseded;
  event.stream.landing = landing;
  event.stream.by = by;
  events_.push_back(std::move(event));
}

}  // namespace terraport
