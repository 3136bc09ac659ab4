#include "Core/Link.h"

#include <algorithm>
#include <random>
#include <utility>

namespace terraport {
namespace {

constexpr int kCloseNormal = 1000, kCloseAbnormal = 1006, kCloseMalformed = 4400, kCloseTimeout = 4408;
/// Ten prefetches a second are enough for a hand that moves.
constexpr double kAimPeriodMs = 100.0;
/// One attempt: TCP, TLS, WebSocket handshake and welcome.
constexpr double kConnectMs = 10000.0;
/// After a connection that lived this long, or completed a landing, the waits begin at the shortest again.
constexpr double kStableMs = 10000.0;
/// Silence of a service that owes an answer: TCP notices a dead connection after minutes only.
constexpr double kSilenceMs = 30000.0;
constexpr double kFirstWaitMs = 500.0, kLongestWaitMs = 30000.0;
/// Share of the service's message rate that is used: clocks of the two sides differ. The rate is averaged over 10 s.
constexpr double kRateShare = 0.8, kRateWindowMs = 10000.0;

std::string codeOfClose(int code) {
  switch (code) {
    case kCloseNormal:
      return "closed";
    case 1001:
    case kCloseAbnormal:
    case 1011:
    case 1012:
      return "unreachable";
    case 4400:
      return "malformed";
    case 4401:
      return "unauthorised";
    case 4403:
      return "forbidden";
    case 4404:
      return "unknown_scene";
    case 4408:
      return "timeout";
    case 4409:
      return "unsupported_version";
    case 4413:
      return "too_large";
    case 4429:
      return "too_many";
    case 4500:
      return "internal";
    case 4503:
      return "draining";
    default:
      return "close_" + std::to_string(code);
  }
}

/// Whether another attempt may succeed as it is.
bool isTemporary(int code) {
  constexpr int kTemporary[] = {1001, kCloseAbnormal, 1011, 1012, kCloseTimeout, 4429, 4500, 4503};
  return std::find(std::begin(kTemporary), std::end(kTemporary), code) != std::end(kTemporary);
}

/// Doubled each time, by chance between half and whole, so that clients do not come back at once.
double waitMs(int attempt) {
  static std::minstd_rand random{std::random_device{}()};
  const double longest = std::min(kLongestWaitMs, kFirstWaitMs * static_cast<double>(1 << std::clamp(attempt, 0, 16)));
  return longest * (0.5 + 0.5 * std::generate_canonical<double, 16>(random));
}

}  // namespace

Link::Link(Context context) : context_(std::move(context)) {}

void Link::pump(double nowMs, std::size_t maxBytes) {
  nowMs_ = std::max(nowMs_, nowMs);
  if (isLeft_) return;
  report();  // What came of commands and decodes, also while there is no connection.
  if (!isBegun_ || (transport_ == nullptr && retryAtMs_ && nowMs_ >= *retryAtMs_)) connect();
  if (transport_ != nullptr) receive(maxBytes);
  if (transport_ != nullptr) send();
  if (transport_ != nullptr) watch();
}

void Link::reconnect() {
  if (isLeft_ || !isBegun_ || (transport_ != nullptr && context_.token() == shownToken_)) return;
  drop();
  attempt_ = 0;
  firstWaitMs_.reset();
  connect();
}

void Link::setGroup(const std::string& group) {
  if (group == group_) return;
  group_ = group;
  if (transport_ == nullptr) return;
  send();  // What is to be said on the old one, a leave for instance.
  drop();
  report();
  attempt_ = 0;
  connect();
}

void Link::leave() {
  if (isLeft_) return;
  isLeft_ = true;
  context_.session.bye();
  if (transport_ != nullptr) {
    for (const Bytes& message : context_.session.takeMessages()) (void)transport_->trySend(message);
  }
  drop();
}

void Link::connect() {
  isBegun_ = true;
  retryAtMs_.reset();
  refusal_.reset();
  welcomedMs_.reset();
  owedSinceMs_.reset();
  isGreeted_ = false;
  connectedAtMs_ = heardMs_ = nowMs_;
  allowance_ = maxAllowance_ = 1.0;
  allowancePerMs_ = 0.0;
  LinkState state;
  state.phase = LinkState::Phase::Connecting;
  state.attempt = ++attempt_;
  shownToken_ = context_.token();
  transport_ = context_.connect(context_.url.stream(group_), kSubprotocol, shownToken_);
  context_.onState(state);
}

void Link::receive(std::size_t maxBytes) {
  const Transport::State state = transport_->state();
  if (!isGreeted_ && state == Transport::State::Open) {
    isGreeted_ = true;
    context_.session.connected();
  }
  for (std::size_t received = 0; received <= maxBytes; received += message_.size()) {
    if (!transport_->tryReceive(message_)) {
      // What came before the close is taken first: it says why.
      if (state == Transport::State::Closed) lost(transport_->closeCode(), transport_->closeReason());
      return;
    }
    heardMs_ = nowMs_;
    const Status status = context_.session.receive(message_);
    report();
    if (transport_ == nullptr) return;
    if (!status.isOk()) {
      refusal_ = Refused{0, "malformed", "the service broke the protocol: " + status.message(), true};
      return cut(kCloseMalformed, "malformed");
    }
  }
}

void Link::report() {
  for (Event& event : context_.session.takeEvents()) {
    note(event);
    context_.onEvent(event);
  }
}

/// Take what concerns the connection itself.
void Link::note(const Event& event) {
  if (const auto* opened = std::get_if<Opened>(&event)) {
    welcomedMs_ = nowMs_;
    wasEverWelcomed_ = true;
    allowancePerMs_ = opened->limits.maxMessagesPerS * kRateShare / 1000.0;
    allowance_ = maxAllowance_ = std::max(1.0, allowancePerMs_ * kRateWindowMs);
    allowanceAtMs_ = nowMs_;
    LinkState state;
    state.phase = LinkState::Phase::Open;
    state.attempt = attempt_;
    context_.onState(state);
  } else if (std::holds_alternative<Complete>(event)) {
    attempt_ = 0;
  } else if (const auto* refused = std::get_if<Refused>(&event)) {
    if (refused->isFatal) refusal_ = *refused;
  } else if (const auto* notice = std::get_if<Notice>(&event)) {
    if (notice->reconnectAfterMs) firstWaitMs_ = notice->reconnectAfterMs;
  }
}

/// While a message waits for its time the session keeps the rest: there landings replace each other, and credit adds up.
void Link::send() {
  Session& session = context_.session;
  allowance_ = std::min(maxAllowance_, allowance_ + (nowMs_ - allowanceAtMs_) * allowancePerMs_);
  allowanceAtMs_ = nowMs_;
  if (outgoing_.empty()) {
    if (session.hasAim() && nowMs_ >= nextAimMs_) {
      nextAimMs_ = nowMs_ + kAimPeriodMs;
      session.flushAim();
    }
    for (Bytes& message : session.takeMessages()) outgoing_.push_back(std::move(message));
  }
  while (!outgoing_.empty() && allowance_ >= 1.0 && transport_->trySend(outgoing_.front())) {
    outgoing_.pop_front();
    allowance_ -= 1.0;
  }
  if (!session.awaitsAnswer()) {
    owedSinceMs_.reset();
  } else if (!owedSinceMs_) {
    owedSinceMs_ = nowMs_;
  }
}

/// Give up a connection on which nothing comes.
void Link::watch() {
  if (!welcomedMs_) {
    if (nowMs_ - connectedAtMs_ > kConnectMs) cut(kCloseTimeout, "no welcome in time");
  } else if (owedSinceMs_ && nowMs_ - std::max({*owedSinceMs_, heardMs_, *welcomedMs_}) > kSilenceMs) {
    cut(kCloseTimeout, "the service is silent");
  }
}

/// Close from this side, without waiting for the other.
void Link::cut(int closeCode, const std::string& reason) {
  transport_->close(closeCode, reason);
  lost(closeCode, reason);
}

void Link::lost(int closeCode, const std::string& reason) {
  drop();
  report();
  if (welcomedMs_ && nowMs_ - *welcomedMs_ >= kStableMs) attempt_ = 0;
  LinkState state;
  state.closeCode = closeCode;
  state.code = refusal_ ? refusal_->code : codeOfClose(closeCode);
  state.message = refusal_ ? refusal_->message : reason;
  if (state.message.empty()) state.message = "the connection ended with code " + std::to_string(closeCode);
  // A token that was refused may have been renewed since; a service that never knew one needs no second attempt.
  const bool isRenewed = closeCode == 4401 && wasEverWelcomed_ && context_.token() != shownToken_;
  if (isTemporary(closeCode) || isRenewed) {
    state.phase = LinkState::Phase::Waiting;
    state.retryInMs = firstWaitMs_.value_or(waitMs(std::max(0, attempt_ - 1)));
    state.attempt = attempt_ + 1;
    retryAtMs_ = nowMs_ + state.retryInMs;
    firstWaitMs_.reset();
  }
  context_.onState(state);
}

void Link::drop() {
  outgoing_.clear();
  retryAtMs_.reset();
  if (transport_ == nullptr) return;
  if (transport_->state() != Transport::State::Closed) transport_->close(kCloseNormal, "");
  transport_.reset();
  context_.session.connectionLost();
}

}  // namespace terraport
