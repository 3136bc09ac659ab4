// What a stage needs of a stream.
#pragma once

#include <optional>

#include "Terraport/Api.h"
#include "Terraport/Types.h"

namespace terraport {

/// A stream of landings, as SceneStage uses it: SceneStream (pumped where it is used) and StreamThread (pumped on a thread of
/// its own) are such. Called from one thread, the stage's; nothing blocks.
class TERRAPORTCORE_API LandingStream {
 public:
  virtual ~LandingStream() = default;

  /// Ask for a landing; it supersedes any that is not ready. Returns its number in the events.
  virtual std::int64_t land(const Vec3& position, double radiusM, const LandOptions& options) = 0;

  /// Tell where the user points; only the newest counts. `coarseRadiusM` as in LandOptions.
  virtual void aim(const Vec3& position, double radiusM, const std::optional<double>& coarseRadiusM = std::nullopt) = 0;

  /// The payload of a held segment; null where it is not held.
  virtual SharedPayload payload(std::uint32_t segment) const = 0;
};

}  // namespace terraport
