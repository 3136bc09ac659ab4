// What the session state machine reports: values, in the order in which they happened.
#pragma once

#include "Messages.generated.h"
#include "Terraport/Types.h"

#include <cstdint>

namespace terraport {

enum class SessionNews : std::uint8_t {
  /// `told`: what the application is told, but for the milliseconds, which the session does not know.
  Told,
  /// `told.landing`, `told.facts`: a segment came with a wrong hash, or was kept by the plan and is not here; it was asked
  /// for again.
  Rejected,
};

/// One piece of news.
struct SessionEvent {
  SessionNews news = SessionNews::Told;
  StreamEvent told;
  /// With `Opened`.
  ServerLimitsPart limits;
};

}  // namespace terraport
