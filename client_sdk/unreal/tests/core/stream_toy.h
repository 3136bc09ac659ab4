// A scene small enough to know by brute force, and chance that can be repeated.
#pragma once

#include "Terraport/Types.h"
#include "Terraport/Xxh3.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

namespace terraport::testing {

/// Numbers in [0, 1), the same for the same seed (mulberry32).
class Seeded {
 public:
  explicit Seeded(std::uint32_t seed) : state_(seed) {}

  double operator()() {
    state_ += 0x6d2b79f5u;
    std::uint32_t t = state_;
    t = (t ^ (t >> 15)) * (t | 1u);
    t ^= t + (t ^ (t >> 7)) * (t | 61u);
    return (t ^ (t >> 14)) / 4294967296.0;
  }

  /// A whole number below `most`.
  int below(int most) { return static_cast<int>((*this)() * most); }

  template <typename T>
  T oneOf(std::initializer_list<T> values) {
    return *(values.begin() + below(static_cast<int>(values.size())));
  }

 private:
  std::uint32_t state_;
};

/// Distance from a point to a box (6.1).
inline double distance(const Vec3& centre, const Box& box) {
  const auto gap = [](double low, double at, double high) { return std::max({low - at, 0.0, at - high}); };
  const double x = gap(box.minX, centre.x, box.maxX);
  const double y = gap(box.minY, centre.y, box.maxY);
  const double z = gap(box.minZ, centre.z, box.maxZ);
  return std::sqrt(x * x + y * y + z * z);
}

/// GRID x GRID segments in the plane y = 0; i is at (2 * (i % GRID), 0, 2 * (i / GRID)), 1 m wide, 10 triangles each.
struct ToyScene {
  static constexpr std::uint32_t kGrid = 6;

  std::string version = "v1";
  std::vector<std::vector<std::uint8_t>> payloads;
  std::vector<SegmentFacts> facts;

  ToyScene() {
    Seeded random(0);
    for (std::uint32_t segment = 0; segment < kGrid * kGrid; ++segment) {
      std::vector<std::uint8_t> payload(static_cast<std::size_t>(1 + random.below(900)));
      for (std::uint8_t& byte : payload) byte = static_cast<std::uint8_t>(random.below(256));
      payloads.emplace_back();
      facts.emplace_back();
      replace(segment, payload);
    }
  }

  void replace(std::uint32_t segment, const std::vector<std::uint8_t>& payload) {
    const auto x = static_cast<float>(2 * (segment % kGrid));
    const auto z = static_cast<float>(2 * (segment / kGrid));
    payloads[segment] = payload;
    SegmentFacts& row = facts[segment];
    row.segment = segment;
    row.length = static_cast<std::uint32_t>(payload.size());
    row.xxh3 = xxh3Hash64({payload.data(), payload.size()});
    row.faces = 10;
    row.vertices = 12;
    row.bounds = {x, 0, z, x + 1, 0, z + 1};
  }

  /// Brute force: ids of the segments that a landing shows.
  std::vector<std::uint32_t> within(const Vec3& centre, double radiusM) const {
    std::vector<std::uint32_t> ids;
    for (const SegmentFacts& row : facts) {
      if (distance(centre, row.bounds) <= radiusM) ids.push_back(row.segment);
    }
    return ids;
  }

  template <typename Ids>
  std::uint64_t bytesOf(const Ids& ids) const {
    std::uint64_t sum = 0;
    for (const std::uint32_t segment : ids) sum += payloads[segment].size();
    return sum;
  }
};

/// Of the toy scene, metres.
constexpr Vec3 kMiddle{ToyScene::kGrid, 0, ToyScene::kGrid};

}  // namespace terraport::testing
