// Where the user points, and what came of it. Pure. Section numbers are those of `spec/wire-protocol.md`.
#pragma once

#include "Messages.generated.h"
#include "Terraport/Types.h"

#include <cstdint>
#include <map>
#include <optional>
#include <vector>

namespace terraport {

/// What aims have brought, and what of it landings have used; of one session, over all its connections.
class AimCounts {
 public:
  /// Landings that had an aim before them.
  std::uint64_t landings = 0;
  /// Those of them whose plan had nothing left to load.
  std::uint64_t hits = 0;
  /// Payload bytes of whole segments that came for aims.
  std::uint64_t prefetchedBytes = 0;
  /// Those of them that the next landing kept.
  std::uint64_t usedBytes = 0;

  /// Note that an aim is answered: the next landing is judged by it.
  void prefetching() { isAimed_ = true; }

  /// Note a whole segment that came for an aim.
  void arrived(std::uint32_t segment, std::uint64_t length);

  /// Judge what came ahead by the plan of the next landing.
  void planned(const std::vector<std::uint32_t>& keep, bool loads);

 private:
  std::map<std::uint32_t, std::uint64_t> ahead_;
  bool isAimed_ = false;
};

/// The newest aim: noted, sent, and sent anew where a lost connection cut it short. Older ones are forgotten; so are all once
/// the user lands.
class AimState {
 public:
  /// Whether an aim is to be sent.
  bool isWaiting() const { return noted_.has_value(); }

  /// Note the newest one, in place of any that waits.
  void note(const Vec3& position, double radiusM, const std::optional<double>& coarseRadiusM) {
    noted_ = Aim{position, radiusM, coarseRadiusM};
  }

  /// The message to send now, under a generation of this connection, whose server allows so large a radius; absent where none
  /// waits.
  std::optional<AimMessage> take(std::uint32_t generation, double maxRadiusM);

  /// Forget it: the user has landed.
  void clear();

  /// Forget it where it was refused: it would be again.
  void refused(const std::optional<std::uint32_t>& generation);

  /// Send it anew on the next connection, unless all of it had come (7, rule 4). `done`: generation of the newest aim of
  /// which everything has come.
  void connectionLost(const std::optional<std::uint32_t>& done);

 private:
  struct Aim {
    Vec3 position;
    double radiusM = 0;
    std::optional<double> coarseRadiusM;
  };

  std::optional<Aim> noted_;
  std::optional<Aim> sent_;
  std::optional<std::uint32_t> generation_;
};

}  // namespace terraport
