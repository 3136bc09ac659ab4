// Payloads of the corpus' scenes, and memory that is used again.
#include <doctest/doctest.h>

#include <atomic>
#include <map>
#include <thread>

#include "LittleEndian.h"
#include "Terraport/DecodeThreads.h"
#include "Terraport/Json.h"
#include "counting_new.h"
#include "test_files.h"

using namespace terraport;
using namespace terraport_tests;

namespace {

/// Payloads of a scene, as they lie in its pack: GLBs, each with its length, at multiples of 64.
std::vector<SharedPayload> payloadsOf(const std::filesystem::path& scene) {
  const std::string text = readText(scene / "scene.json");
  JsonDocument document;
  REQUIRE(document.read(text).isOk());
  const auto path = document.root().member("files").member("segments.pack").member("path").text();
  REQUIRE(path);
  const std::vector<std::uint8_t> pack = readFile(scene / std::string(*path));
  std::vector<SharedPayload> payloads;
  for (std::size_t at = 64; at + 12 <= pack.size(); at = (at + readU32(&pack[at + 8]) + 63) / 64 * 64) {
    const std::size_t end = at + readU32(&pack[at + 8]);
    REQUIRE((pack[at] == 'g' && end <= pack.size()));
    payloads.push_back(std::make_shared<std::vector<std::uint8_t>>(&pack[at], pack.data() + end));
  }
  CHECK(payloads.size() >= 4);
  return payloads;
}

}  // namespace

TEST_SUITE("payloads") {
  TEST_CASE("decoding allocates nothing once the buffers are large enough") {
    std::vector<SharedPayload> all;
    for (const char* name : {"tiny", "tiny-textured", "axes"}) {
      for (SharedPayload& payload : payloadsOf(conformance() / "scene" / name)) {
        all.push_back(std::move(payload));
      }
    }
    SegmentMesh mesh;
    std::size_t before = 0;
    for (int round = 0; round < 4; ++round) {
      before = allocationCount();
      for (std::uint32_t segment = 0; segment < all.size(); ++segment) {
        DecodeJob job;
        job.segment = segment;
        job.payload = all[segment];
        if (!decodePayload(job, mesh).isOk()) {
          FAIL("does not decode");
        }
      }
    }
    CHECK(allocationCount() == before);
  }

  TEST_CASE("threads decode what they are given, and meshes come back for their memory") {
    const std::vector<SharedPayload> payloads = payloadsOf(conformance() / "scene" / "axes");
    std::atomic<int> prepared{0};
    DecodeThreads queue(3, [&](SegmentMesh&, const SharedPayload& payload) { prepared += payload ? 1 : 0; }, 4);
    for (int round = 0; round < 20; ++round) {
      std::map<std::uint32_t, int> answers;
      for (std::uint32_t segment = 0; segment < payloads.size(); ++segment) {
        DecodeJob job;
        job.segment = segment;
        job.epoch = 9;
        job.payload = segment == 2 ? std::make_shared<const std::vector<std::uint8_t>>(40) : payloads[segment];
        queue.push(std::move(job));
      }
      std::size_t count = 0;
      while (count < payloads.size()) {
        DecodedSegment answer;
        if (!queue.tryPop(answer)) {
          std::this_thread::yield();
          continue;
        }
        ++count;
        ++answers[answer.segment];
        CHECK(answer.epoch == 9);
        CHECK(answer.status.isOk() == (answer.segment != 2));
        CHECK((answer.status.isOk() ? answer.mesh->segment == answer.segment : answer.mesh->vertexCount == 0));
        queue.release(std::move(answer.mesh));
      }
      CHECK(answers.size() == payloads.size());
    }
    CHECK(prepared == 20 * static_cast<int>(payloads.size() - 1));
  }
}
