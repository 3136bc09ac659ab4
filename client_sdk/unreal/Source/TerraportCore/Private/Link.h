// The connection of a session: opened, kept, lost, opened again. The state is the session's; here are the transport and the
// clock. Section numbers are those of `spec/wire-protocol.md`.
#pragma once

#include "Access.h"
#include "LinkPacer.h"
#include "Session.h"
#include "SessionEvents.h"
#include "Terraport/Transport.h"

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace terraport {

/// Keeps one session connected until `leave`.
class Link {
 public:
  struct Context {
    ClientSession& session;
    TransportFactory& transports;
    /// `ws(s)://.../stream`.
    std::string url;
    Access access;
    /// A number in [0, 1), another one each time.
    std::function<double()> chance;
    /// Takes the session's events, one by one in order.
    std::function<void(SessionEvent&)> onEvent;
    /// Takes every change of the connection itself.
    std::function<void(const LinkState&)> onState;
    /// Whether whoever takes the events wants more now; else nothing is received.
    std::function<bool()> wantsMore;
  };

  explicit Link(Context context);

  /// Do everything that is due; connects the first time. Takes about `maxBytes` of messages, at least one message.
  void pump(double nowMs, std::size_t maxBytes);

  /// Connect now, unless there is a connection already; another token makes a new one in any case.
  void reconnect(const std::string& token);

  /// Connect to that address from now on, and now, unless it was closed for good.
  void moveTo(std::string url);

  /// Say goodbye and do not connect again.
  void leave();

  double nowMs() const { return nowMs_; }

  /// Nothing is due yet, but time goes on: landings count from it.
  void wait(double nowMs) { nowMs_ = nowMs; }

 private:
  struct Refusal {
    std::string code;
    std::string message;
  };

  void connect();
  void receive(std::size_t maxBytes);
  void onOpen();
  void report();
  void note(const SessionEvent& event);
  void speak();
  void proceed();
  void watch();
  void cut(int closeCode, const std::string& reason);
  void lost(int closeCode, const std::string& reason);
  bool retriesWithoutHeld();
  void drop(int closeCode);

  Context context_;
  std::unique_ptr<Transport> transport_;
  TransportMessage message_;
  double nowMs_ = 0;
  int attempt_ = 0;
  bool offersHeld_ = true;
  bool isBegun_ = false;
  bool isLeft_ = false;
  bool isGreeted_ = false;
  /// By any connection: a service that never knew the token needs no second attempt with another.
  bool wasEverWelcomed_ = false;
  /// The error that the server gave as reason for the close which follows.
  std::optional<Refusal> refusal_;
  std::optional<double> firstWaitMs_;
  std::optional<double> retryAtMs_;
  double connectedAtMs_ = 0;
  std::optional<double> welcomedMs_;
  double heardMs_ = 0;
  std::optional<double> owedSinceMs_;
  double nextAimMs_ = 0;

  // What goes out, no faster than the server allows.
  Pacer pacer_;
  std::deque<EncodedMessage> outgoing_;
  /// When the first of them may go; it is booked then.
  std::optional<double> sendAtMs_;
};

}  // namespace terraport
