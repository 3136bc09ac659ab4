// Keeps a session connected: connects, connects again, and paces what is sent.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "Core/SceneUrl.h"
#include "Core/Session.h"
#include "Core/Transport.h"

namespace terraport {

/// A change of the connection.
struct LinkState {
  enum class Phase : std::uint8_t { Connecting, Open, Waiting, Closed };

  Phase phase = Phase::Closed;
  /// Number of the attempt, from 1.
  int attempt = 0;
  double retryInMs = 0.0;
  /// Of the connection that ended.
  int closeCode = 0;
  /// Why, for programs and for people.
  std::string code, message;
};

class Link {
 public:
  struct Context {
    Session& session;
    TransportFactory connect;
    SceneUrl url;
    /// The present token; empty for none.
    std::function<std::string()> token;
    /// Takes every event of the session, in order.
    std::function<void(Event&)> onEvent;
    std::function<void(const LinkState&)> onState;
  };

  explicit Link(Context context);

  /// Once a frame: receive at most about `maxBytes`, and send what is due.
  void pump(double nowMs, std::size_t maxBytes);
  /// Connect now: after it was closed for good, to end a wait, or because there is another token.
  void reconnect();
  /// Connect by a URL that names a group, for proxies that route by it.
  void setGroup(const std::string& group);
  /// Say goodbye, and connect no more.
  void leave();

 private:
  void connect();
  void receive(std::size_t maxBytes);
  void report();
  void note(const Event& event);
  void send();
  void watch();
  void cut(int closeCode, const std::string& reason);
  void lost(int closeCode, const std::string& reason);
  void drop();

  Context context_;
  std::unique_ptr<Transport> transport_;
  std::string group_;
  std::string shownToken_;
  double nowMs_ = 0.0;
  bool isBegun_ = false, isLeft_ = false, isGreeted_ = false, wasEverWelcomed_ = false;
  int attempt_ = 0;
  std::optional<double> retryAtMs_, welcomedMs_, owedSinceMs_, firstWaitMs_;
  double connectedAtMs_ = 0.0, heardMs_ = 0.0, nextAimMs_ = 0.0;
  /// Messages that may be sent now by the service's rate; refilled with time.
  double allowance_ = 1.0, allowancePerMs_ = 0.0, maxAllowance_ = 1.0, allowanceAtMs_ = 0.0;
  std::optional<Refused> refusal_;
  std::deque<Bytes> outgoing_;
  Bytes message_;
};

}  // namespace terraport
