// What the session state machine reports: values, in the order in which they happened.
#pragma once

#include "Messages.generated.h"
#include "Terraport/Types.h"

#include <cstdint>

namespace terraport {

enum class SessionNews : std::uint8_t {
  /// `stream` goes on to the application. Its `elapsedMs` is still empty: the session has no clock.
  Stream,
  /// `stream.landing`, `stream.facts`: a segment came with a wrong hash, or was kept by the plan and is not here; it was asked
  /// for again.
  Rejected,
};

/// One event, in the order in which it happened.
struct SessionEvent {
  SessionNews news = SessionNews::Stream;
  StreamEvent stream;
  /// With `Opened`.
  ServerLimitsPart limits;
};

}  // namespace terraport
