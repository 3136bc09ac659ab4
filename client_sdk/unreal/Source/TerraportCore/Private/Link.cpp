#include "Link.h"

#include "Backoff.h"
#include "WireErrors.h"

#include <algorithm>
#include <utility>

namespace terraport {

namespace {

/// Between two aims: a hand moves faster, but ten plans a second are enough to prefetch by.
constexpr double kAimPeriodMs = 100;

/// One attempt: TCP, TLS, WebSocket handshake and welcome.
constexpr double kConnectMs = 10000;

/// A connection that lived this long, or readied a landing, begins the waits anew when it is lost.
constexpr double kStableMs = 10000;

/// Silence of a server that owes an answer: a dead line is noticed by TCP after minutes only.
constexpr double kSilenceMs = 30000;

/// Before the welcome says what is allowed: hello, and nothing else.
constexpr double kGreetingPerS = 1;

std::string textOf(int closeCode) {
  return closeCode == kCloseAbnormal ? "no connection to the server"
                                     : "the connection was closed with " + std::to_string(closeCode);
}

}  // namespace

Link::Link(Context context) : context_(std::move(context)), pacer_(kGreetingPerS, 0) {}

void Link::pump(double nowMs, std::size_t maxBytes) {
  // A clock that runs back, or is none, must not undo what was timed.
  if (nowMs > nowMs_) nowMs_ = nowMs;
  if (isLeft_) return;
  if (!isBegun_) {
    isBegun_ = true;
    connect();
  } else if (transport_ == nullptr && retryAtMs_ && nowMs_ >= *retryAtMs_) {
    connect();
  }
  if (transport_ != nullptr) receive(maxBytes);
  if (transport_ != nullptr) speak();
  if (transport_ != nullptr) watch();
}

void Link::reconnect(const std::string& token) {
  if (isLeft_) return;
  const bool isNewer = context_.access.replace(token);
  if (!isBegun_ || (transport_ != nullptr && !isNewer)) return;
  drop(kCloseNormal);
  attempt_ = 0;
  firstWaitMs_.reset();
  connect();
}

void Link::moveTo(std::string url) {
  context_.url = std::move(url);
  if (isLeft_ || !isBegun_ || (transport_ == nullptr && !retryAtMs_)) return;
  // What is to be said to the old one, a goodbye to its group for instance.
  if (transport_ != nullptr) speak();
  drop(kCloseNormal);
  report();
  attempt_ = 0;
  connect();
}

void Link::leave() {
  if (isLeft_) return;
  isLeft_ = true;
  context_.session.bye();
  if (transport_ != nullptr && outgoing_.empty()) {
    for (const EncodedMessage& message : context_.session.takeMessages()) {
      if (!transport_->trySend(message.view())) break;
    }
  }
  drop(kCloseNormal);
}

// ---- one connection

void Link::connect() {
  retryAtMs_.reset();
  attempt_ += 1;
  refusal_.reset();
  welcomedMs_.reset();
  isGreeted_ = false;
  connectedAtMs_ = nowMs_;
  heardMs_ = nowMs_;
  LinkState state;
  state.phase = LinkPhase::Connecting;
  state.attempt = static_cast<std::uint32_t>(attempt_);
  context_.onState(state);
  transport_ = context_.transports.make();
  transport_->open(context_.url, {kSubprotocol}, context_.access.show());
}

void Link::onOpen() {
  isGreeted_ = true;
  const std::string chosen = transport_->subprotocol();
  // Where the server chose none it closes with 4409 by itself, which says more.
  if (!chosen.empty() && chosen != kSubprotocol) {
    cut(kCloseMalformed, "the server chose a subprotocol that was not offered");
    return;
  }
  context_.session.connected(offersHeld_);
}

void Link::receive(std::size_t maxBytes) {
  const TransportState state = transport_->state();
  if (!isGreeted_ && state != TransportState::Connecting) {
    if (state == TransportState::Open) onOpen();
    if (transport_ == nullptr) return;
  }
  std::size_t receivedBytes = 0;
  bool isDry = false;
  while (context_.wantsMore() && (receivedBytes == 0 || receivedBytes < maxBytes)) {
    if (!transport_->tryReceive(message_)) {
      isDry = true;
      break;
    }
    receivedBytes += std::max<std::size_t>(message_.bytes.size(), 1);
    heardMs_ = nowMs_;
    const Status status = context_.session.receive({message_.bytes.data(), message_.bytes.size()}, message_.isText);
    report();
    if (!status.isOk()) {
      refusal_ = Refusal{"malformed", "the server broke the protocol: " + status.message()};
      cut(kCloseMalformed, "malformed");
      return;
    }
  }
  // What came before the close is taken first: it says why.
  if (isDry && state == TransportState::Closed) lost(transport_->closeCode(), transport_->closeReason());
}

void Link::report() {
  for (SessionEvent& event : context_.session.takeEvents()) {
    note(event);
    context_.onEvent(event);
  }
}

/// Take what concerns the connection itself.
void Link::note(const SessionEvent& event) {
  if (event.news != SessionNews::Stream) return;
  const StreamEvent& streamEvent = event.stream;
  if (streamEvent.kind == EventKind::Opened) {
    welcomedMs_ = nowMs_;
    wasEverWelcomed_ = true;
    pacer_ = Pacer(event.limits.maxMessagesPerS, nowMs_);
    LinkState state;
    state.phase = LinkPhase::Open;
    context_.onState(state);
  } else if (streamEvent.kind == EventKind::Ready) {
    attempt_ = 0;
  } else if (streamEvent.kind == EventKind::Refused && streamEvent.fatal) {
    refusal_ = Refusal{streamEvent.code, streamEvent.message};
  } else if (streamEvent.kind == EventKind::Notice && streamEvent.reconnectAfterMs) {
    firstWaitMs_ = *streamEvent.reconnectAfterMs;
  }
}

/// Hand out events and send what the session has to say. While something waits for its time the session keeps the rest:
/// there landings replace each other, and grants add up.
void Link::speak() {
  ClientSession& session = context_.session;
  report();
  if (outgoing_.empty()) {
    if (session.hasAim() && nowMs_ >= nextAimMs_) {
      nextAimMs_ = nowMs_ + kAimPeriodMs;
      session.flushAim();
    }
    for (EncodedMessage& message : session.takeMessages()) outgoing_.push_back(std::move(message));
  }
  proceed();
  if (!session.awaitsAnswer()) {
    owedSinceMs_.reset();
  } else if (!owedSinceMs_) {
    owedSinceMs_ = nowMs_;
  }
}

void Link::proceed() {
  while (!outgoing_.empty()) {
    if (!sendAtMs_) sendAtMs_ = nowMs_ + pacer_.take(nowMs_);
    if (nowMs_ < *sendAtMs_) return;
    if (!transport_->trySend(outgoing_.front().view())) return;
    sendAtMs_.reset();
    outgoing_.pop_front();
  }
}

/// Give up a connection on which nothing comes about.
void Link::watch() {
  if (!welcomedMs_) {
    if (nowMs_ - connectedAtMs_ > kConnectMs) cut(kCloseTimeout, "no welcome in time");
    return;
  }
  if (!owedSinceMs_) return;
  const double sinceMs = std::max({*owedSinceMs_, heardMs_, *welcomedMs_});
  if (nowMs_ - sinceMs > kSilenceMs) cut(kCloseTimeout, "the server is silent");
}

/// Close from this side, without waiting for the other: its answer may never come.
void Link::cut(int closeCode, const std::string& reason) {
  transport_->close(closeCode, reason);
  lost(closeCode, reason);
}

void Link::lost(int closeCode, const std::string& reason) {
  drop(kCloseNormal);
  report();
  if (retriesWithoutHeld()) {
    connect();
    return;
  }
  if (welcomedMs_ && nowMs_ - *welcomedMs_ >= kStableMs) attempt_ = 0;
  LinkState state;
  state.closeCode = closeCode;
  state.code = refusal_ ? refusal_->code : codeOfClose(closeCode);
  state.message = refusal_ ? refusal_->message : reason.empty() ? textOf(closeCode) : reason;
  const AfterClose after = afterClose(closeCode);
  const bool isRenewed = after == AfterClose::Token && wasEverWelcomed_ && context_.access.hasNewer();
  if (after != AfterClose::Again && !isRenewed) {
    state.phase = LinkPhase::Closed;
    context_.onState(state);
    return;
  }
  state.phase = LinkPhase::Waiting;
  state.retryInMs = firstWaitMs_.value_or(waitMs(std::max(0, attempt_ - 1), context_.chance()));
  state.attempt = static_cast<std::uint32_t>(attempt_ + 1);
  firstWaitMs_.reset();
  retryAtMs_ = nowMs_ + state.retryInMs;
  context_.onState(state);
}

/// Offer nothing in hello from now on if the server found that too large; once.
bool Link::retriesWithoutHeld() {
  if (!refusal_ || refusal_->code != "too_large" || welcomedMs_ || !offersHeld_) return false;
  offersHeld_ = false;
  return true;
}

/// Part from the transport and from everything that was timed for it.
void Link::drop(int closeCode) {
  outgoing_.clear();
  sendAtMs_.reset();
  pacer_ = Pacer(kGreetingPerS, nowMs_);
  owedSinceMs_.reset();
  retryAtMs_.reset();
  if (transport_ == nullptr) return;
  if (transport_->state() != TransportState::Closed) transport_->close(closeCode, "");
  transport_.reset();
  context_.session.connectionLost();
}

}  // namespace terraport
