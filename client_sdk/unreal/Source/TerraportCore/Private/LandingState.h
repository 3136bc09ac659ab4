// What the session knows of one landing or prefetch that is on its way. Pure.
#pragma once

#include "Messages.generated.h"
#include "Terraport/Types.h"

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <vector>

namespace terraport {

/// The ring's radius, cut to what the server allows: a landing with less coarse ground is better than none.
std::optional<double> ringOf(double radiusM, const std::optional<double>& coarseRadiusM, double maxRadiusM);

/// The message that asks for a landing, of a server that allows so large a radius.
LandMessage landMessage(
    std::uint32_t generation, const Vec3& position, double radiusM, const LandOptions& options, double maxRadiusM);

/// One landing that the user asked for, over as many generations as reconnecting takes.
struct LandingState {
  /// The session's own number, the same over reconnects.
  std::int64_t number = kNoLanding;
  Vec3 position;
  double radiusM = 0;
  LandOptions options;
  /// Generation on the present connection; absent before it was sent there.
  std::optional<std::uint32_t> generation;
  /// Of the load table, and of segments of `keep` that are sent after all, by id.
  std::map<std::uint32_t, SegmentFacts> facts;
  /// Facts of segments rejected after this landing was asked for and before its plan came, by id: the plan may still keep
  /// them, and the server sends them again (6.4, rule 7).
  std::map<std::uint32_t, SegmentFacts> crossed;
  /// Ids of load and keep.
  std::set<std::uint32_t> planned;
  /// Wanted ids whose payload is not here yet.
  std::set<std::uint32_t> waiting;
  /// Ids of the latest `ready.missing`.
  std::set<std::uint32_t> missing;
  /// How often each came wrong in this generation.
  std::map<std::uint32_t, int> rejects;
  /// The declared inner set, until it has been reported.
  std::optional<std::vector<std::uint32_t>> inner;
  bool isReadySeen = false;
  /// Chunk bytes that came for it, in all its generations.
  std::uint64_t payloadBytes = 0;
  /// Whether it became ready for the client.
  bool isDone = false;

  /// The message that asks for it under a generation, of a server that allows so large a radius.
  LandMessage message(std::uint32_t asGeneration, double maxRadiusM) const;

  /// Take the plan of a generation, in place of any before.
  void begin(const PlanMessage& plan);

  /// Wait for a segment of `keep` that is not here after all.
  void expectAgain(const SegmentFacts& segment);

  /// Whether it is ready for the client (6.4, rule 5).
  bool isComplete() const;

  /// Ids to show once complete: those planned whose payload is here, ascending.
  std::vector<std::uint32_t> shown() const;
};

/// Segments that the server sends ahead for an aim.
struct PrefetchState {
  std::uint32_t generation = 0;
  std::map<std::uint32_t, SegmentFacts> facts;
  std::set<std::uint32_t> waiting;
  std::uint64_t bytes = 0;
  /// How often each came with a wrong hash.
  std::map<std::uint32_t, int> rejects;
};

/// State at its start: every segment of the message is waited for.
PrefetchState prefetchState(const PrefetchMessage& prefetch);

}  // namespace terraport
