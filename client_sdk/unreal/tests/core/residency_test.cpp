// What the random walks of the stage do not reach.
#include "Residency.h"

#include <doctest/doctest.h>

using namespace terraport;

TEST_CASE("residency remembers the newest 4096 of what aims brought, while there is no room for it") {
  constexpr std::size_t kBytes = 100;
  ShelfLimits limits;
  limits.maxInFlight = 4;
  limits.maxInFlightBytes = std::size_t{1} << 30;
  limits.spareBytes = kBytes;
  Residency residency(limits);
  SegmentFacts facts;
  std::vector<ResidencyRequest> requests;

  residency.arrived(facts, kNoLanding);
  residency.takeDecodes(requests);
  REQUIRE(requests.size() == 1);
  REQUIRE(residency.decoded(0, requests[0].epoch, kBytes));
  for (facts.segment = 1; facts.segment <= 4096 + 2; ++facts.segment) {
    residency.arrived(facts, kNoLanding);
  }
  requests.clear();
  residency.takeDecodes(requests);
  CHECK(requests.empty());

  PlanFacts plan;
  plan.keep = {0};  // Spare no longer.
  residency.land(1, Vec3{0.0, 0.0, 0.0}, 60.0, 0.0);
  residency.planned(plan, 1);
  residency.takeDecodes(requests);
  REQUIRE(!requests.empty());
  CHECK(requests.front().segment == 3);
}
