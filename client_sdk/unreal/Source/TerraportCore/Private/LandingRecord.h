// What is known of one landing: its plan, what arrived, and what its `degraded` and `ready` said is to be shown.
#pragma once

#include <cstdint>
#include <string>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "Terraport/Types.h"

namespace terraport {

using SegmentList = std::vector<std::uint32_t>;

/// How much of a landing is shown: nothing yet, its declared inner part, or all of it.
enum class ShownExtent : std::uint8_t { Nothing, Degraded, Full };

/// One landing, from `land` until a newer one. No clock, no I/O.
class LandingRecord {
 public:
  std::int64_t landing = kNoLanding;
  Vec3 position;
  double radiusM = 0.0;
  double requestedAtMs = 0.0;
  bool hasPlan = false;
  double effectiveRadiusM = 0.0;
  SegmentList missing;
  bool isRefused = false;
  std::string refusal;
  /// Milliseconds since the landing was asked for; negative before.
  double readyMs = -1.0;
  double presentableMs = -1.0;
  std::uint64_t payloadBytes = 0;
  ShownExtent shown = ShownExtent::Nothing;

  /// A plan came: the first, or another one after a reconnect. What was shown stays shown until the next `ready`.
  void planned(const PlanFacts& plan);
  void arrived(const SegmentFacts& facts);
  void degrade(const SegmentList& segments);
  void ready(const SegmentList& visible, const SegmentList& missing, double elapsedMs, std::uint64_t bytes);
  void refuse(const std::string& message);
  /// A new scene version: there is no plan of it yet.
  void restart();

  /// What may be shown next, once it is drawable; null where nothing was declared yet, or the inner part is shown.
  const SegmentList* target() const;
  /// Whether the target is all of the landing, and not the declared inner part.
  bool isTargetWhole() const { return hasWhole_; }
  /// What `ready` will presumably say: the plan's load and keep, in the plan's order; null without a plan.
  const SegmentList* expected() const { return hasPlan && !isRefused ? &expected_ : nullptr; }

  /// Bytes that came and were made drawable, of those that must: each half counts once.
  template <typename IsDrawable>
  double fraction(IsDrawable&& isDrawable) const {
    if (!hasPlan) {
      return 0.0;
    }
    double total = 0.0;
    double done = 0.0;
    for (const auto& [segment, bytes] : loadBytes_) {
      total += 2.0 * bytes;
      done += hasWhole_ || arrived_.count(segment) != 0 ? bytes : 0;
      done += isDrawable(segment) ? bytes : 0;
    }
    return total > 0.0 ? done / total : 1.0;
  }

 private:
  SegmentList inner_;
  bool hasInner_ = false;
  SegmentList whole_;
  bool hasWhole_ = false;
  SegmentList expected_;
  std::unordered_map<std::uint32_t, std::uint32_t> loadBytes_;
  std::unordered_set<std::uint32_t> arrived_;
};

}  // namespace terraport
