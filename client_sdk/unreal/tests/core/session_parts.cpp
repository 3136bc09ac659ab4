// The small pure units: cache, assembly, waits, pace, close codes.
#include "Backoff.h"
#include "Cache.h"
#include "LinkPacer.h"
#include "SessionAssembly.h"
#include "WireErrors.h"
#include "stream_toy.h"

#include <doctest/doctest.h>

#include <algorithm>

using namespace terraport;
using namespace terraport::testing;

namespace {

CachedSegment entryOf(std::uint32_t segment, std::size_t size) {
  CachedSegment entry;
  entry.facts.segment = segment;
  entry.facts.length = static_cast<std::uint32_t>(size);
  entry.payload = std::make_shared<const std::vector<std::uint8_t>>(size);
  return entry;
}

std::vector<std::uint32_t> idsOf(const SegmentCache& cache) {
  std::vector<std::uint32_t> ids;
  for (const CachedSegment& entry : cache.entries()) ids.push_back(entry.facts.segment);
  return ids;
}

std::vector<std::uint32_t> trimmed(SegmentCache& cache) {
  std::vector<std::uint32_t> ids;
  for (const SegmentFacts& facts : cache.trim()) ids.push_back(facts.segment);
  return ids;
}

struct Chunks {
  std::vector<std::uint8_t> payload = std::vector<std::uint8_t>(40);

  Chunks() {
    for (std::size_t at = 0; at < payload.size(); ++at) payload[at] = static_cast<std::uint8_t>(at);
  }

  PayloadFrame chunk(std::uint32_t start, std::uint32_t end, std::uint32_t segment = 1) const {
    PayloadFrame frame;
    frame.segment = segment;
    frame.offset = start;
    frame.total = 40;
    frame.isLast = end == 40;
    frame.chunk = {payload.data() + start, end - start};
    return frame;
  }
};

}  // namespace

TEST_CASE("cache: does over any history what a list does slowly") {
  for (std::uint32_t seed = 0; seed < 100; ++seed) {
    Seeded random(seed);
    const auto maxBytes = static_cast<std::uint64_t>(random.below(120));
    SegmentCache cache(maxBytes);
    // Id and size, least recently used first.
    std::vector<std::pair<std::uint32_t, std::uint64_t>> model;
    std::set<std::uint32_t> pinned;
    const auto bytes = [&model] {
      std::uint64_t sum = 0;
      for (const auto& entry : model) sum += entry.second;
      return sum;
    };
    for (int step = 0; step < 60; ++step) {
      // 1. The same action on both.
      const int action = random.below(5);
      const auto id = static_cast<std::uint32_t>(random.below(7));
      const auto entry =
          std::find_if(model.begin(), model.end(), [id](const auto& candidate) { return candidate.first == id; });
      const bool isCached = entry != model.end();
      if (action == 0) {
        const auto size = static_cast<std::uint64_t>(1 + random.below(50));
        cache.put(entryOf(id, size));
        if (isCached) model.erase(entry);
        model.emplace_back(id, size);
      } else if (action == 1) {
        CHECK((cache.get(id) != nullptr) == isCached);
        if (isCached) std::rotate(entry, entry + 1, model.end());
      } else if (action == 2) {
        CHECK(cache.discard(id) == isCached);
        if (isCached) model.erase(entry);
      } else if (action == 3) {
        pinned = {id, (id + 1) % 7};
        cache.pin(pinned);
      } else {
        std::vector<std::uint32_t> evicted;
        for (auto oldest = model.begin(); oldest != model.end() && bytes() > maxBytes;) {
          if (pinned.count(oldest->first) != 0) {
            ++oldest;
          } else {
            evicted.push_back(oldest->first);
            oldest = model.erase(oldest);
          }
        }
        CHECK(trimmed(cache) == evicted);
      }
      // 2. The same ids in the same order of age, and as many bytes.
      std::vector<std::uint32_t> ids;
      for (const auto& cached : model) ids.push_back(cached.first);
      CHECK(idsOf(cache) == ids);
      CHECK(cache.bytes() == bytes());
    }
  }
}

TEST_CASE("cache: a peek does not change an age; a payload outlives its eviction") {
  SegmentCache cache(10);
  cache.put(entryOf(1, 5));
  cache.put(entryOf(2, 5));
  REQUIRE(cache.peek(1) != nullptr);
  const SharedPayload kept = cache.peek(1)->payload;
  cache.put(entryOf(3, 5));
  CHECK(trimmed(cache) == std::vector<std::uint32_t>{1});
  CHECK(kept->size() == 5);
}

TEST_CASE("assembly: gives the payload however it was cut") {
  const Chunks chunks;
  for (std::uint32_t seed = 0; seed < 50; ++seed) {
    Seeded random(seed);
    Assembler assembler;
    SharedPayload whole;
    for (std::uint32_t at = 0; at < 40;) {
      CHECK_FALSE(static_cast<bool>(whole));
      const std::uint32_t end = std::min(40u, at + 1 + static_cast<std::uint32_t>(random.below(20)));
      REQUIRE(assembler.take(chunks.chunk(at, end), 40, whole).isOk());
      at = end;
    }
    REQUIRE(static_cast<bool>(whole));
    CHECK(*whole == chunks.payload);
    CHECK(assembler.size() == 0);
  }
}

TEST_CASE("assembly: refuses a gap, an overlap and a wrong total; forgets what a plan does not need") {
  const Chunks chunks;
  Assembler assembler;
  SharedPayload whole;
  REQUIRE(assembler.take(chunks.chunk(0, 3), 40, whole).isOk());
  CHECK(assembler.take(chunks.chunk(2, 4), 40, whole).message().find("byte 2, expected 3") != std::string::npos);
  CHECK(assembler.take(chunks.chunk(4, 5), 40, whole).message().find("byte 4, expected 3") != std::string::npos);
  CHECK(assembler.take(chunks.chunk(3, 5), 39, whole).message().find("announces 40 bytes") != std::string::npos);
  REQUIRE(assembler.take(chunks.chunk(0, 3, 2), 40, whole).isOk());
  CHECK(assembler.size() == 2);
  assembler.keepOnly({{2, SegmentFacts()}});
  CHECK(assembler.take(chunks.chunk(3, 5, 1), 40, whole).message().find("expected 0") != std::string::npos);
  CHECK(assembler.take(chunks.chunk(3, 5, 2), 40, whole).isOk());
  assembler.clear();
  CHECK(assembler.size() == 0);
  CHECK_FALSE(static_cast<bool>(whole));
}

TEST_CASE("link: waits stay between half and all of the doubling") {
  for (const int attempt : {0, 1, 3, 5, 6, 60, 1000000}) {
    const double most = std::min(30000.0, 500 * std::pow(2.0, std::min(attempt, 30)));
    CHECK(waitMs(attempt, 0) == most / 2);
    CHECK(waitMs(attempt, 0.5) == 0.75 * most);
    CHECK(waitMs(attempt, 0.9999) <= most);
  }
}

TEST_CASE("link: connects again after exactly the close codes that the protocol lists (11)") {
  for (const int code : {1001, 1006, 1011, 1012, 4408, 4429, 4500, 4503}) CHECK(afterClose(code) == AfterClose::Again);
  for (const int code : {4400, 4403, 4404, 4409, 4413}) CHECK(afterClose(code) == AfterClose::Stop);
  CHECK(afterClose(1000) == AfterClose::Done);
  CHECK(afterClose(4401) == AfterClose::Token);
  CHECK(codeOfClose(4404) == "unknown_scene");
  CHECK(codeOfClose(1006) == "closed");
}

TEST_CASE("link: the pace is one that the server's own bucket never finds too fast (12)") {
  for (std::uint32_t seed = 0; seed < 50; ++seed) {
    Seeded random(seed);
    const double perS = 0.5 + random() * 200;
    double nowMs = 1000;
    Pacer pacer(perS, nowMs);
    double tokens = std::max(1.0, perS * 10);
    for (int message = 0; message < 300; ++message) {
      const double beforeMs = nowMs;
      nowMs += random() * 3000 * (seed % 2);
      nowMs += pacer.take(nowMs);
      tokens = std::min(std::max(1.0, perS * 10), tokens + (nowMs - beforeMs) / 1000 * perS) - 1;
      CHECK(tokens >= -1e-6);
    }
  }
}
