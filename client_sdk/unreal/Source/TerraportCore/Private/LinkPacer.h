// How fast the client may speak: the server's message rate, kept from this side. Pure; time is an argument.
#pragma once

#include <algorithm>

namespace terraport {

/// Token bucket that stays within `perS` messages per second over 10 s (wire protocol, section 12).
class Pacer {
 public:
  Pacer(double perS, double nowMs)
      : perMs_(perS * kMargin / 1000), capacity_(std::max(1.0, perS * kMargin * kWindowS)), tokens_(capacity_), atMs_(nowMs) {}

  /// Book one message; milliseconds to wait before sending it, 0 for none.
  double take(double nowMs) {
    tokens_ = std::min(capacity_, tokens_ + std::max(0.0, nowMs - atMs_) * perMs_) - 1;
    atMs_ = std::max(atMs_, nowMs);
    return std::max(0.0, -tokens_ / perMs_);
  }

 private:
  static constexpr double kWindowS = 10;
  /// Part of the allowance that is used: clocks and batching differ between the two sides.
  static constexpr double kMargin = 0.8;

  double perMs_;
  double capacity_;
  double tokens_;
  double atMs_;
};

}  // namespace terraport
