// Payloads of the corpus' scenes, and memory that is used again.
#include <doctest/doctest.h>

#include <atomic>
#include <map>
#include <thread>

#include "LittleEndian.h"
#include "Manifest.h"
#include "Terraport/DecodeThreads.h"
#include "Terraport/Json.h"
#include "counting_new.h"
#include "test_files.h"

using namespace terraport;
using namespace terraport_tests;

namespace {

/// Segments of a scene, as they lie in its pack: each has its lengths, and begins at a multiple of 64.
std::vector<DecodeJob> jobsOf(const std::filesystem::path& scene) {
  const std::string text = readText(scene / "scene.json");
  JsonDocument document;
  REQUIRE(document.read(text).isOk());
  const auto path = document.root().member("files").member("segments.pack").member("path").text();
  REQUIRE(path);
  CheckedManifest checked;
  const std::vector<std::uint8_t> json(text.begin(), text.end());
  REQUIRE(readManifest(viewOf(json), "scene", checked).isOk());
  const auto files = std::make_shared<SceneFiles>();
  files->manifest = checked.manifest;
  const std::vector<std::uint8_t> pack = readFile(scene / std::string(*path));
  std::vector<DecodeJob> jobs;
  for (std::size_t at = 64, end = 0; at + 12 <= pack.size(); at = (end + 63) / 64 * 64) {
    end = at + 12 + readU32(&pack[at + 4]) + readU32(&pack[at + 8]);
    REQUIRE((pack[at] == 'T' && end <= pack.size()));
    DecodeJob job;
    job.segment = static_cast<std::uint32_t>(jobs.size());
    job.payload = std::make_shared<std::vector<std::uint8_t>>(&pack[at], pack.data() + end);
    job.files = files;
    jobs.push_back(std::move(job));
  }
  CHECK(jobs.size() >= 4);
  return jobs;
}

}  // namespace

TEST_SUITE("payloads") {
  TEST_CASE("decoding allocates nothing once the buffers are large enough") {
    std::vector<DecodeJob> all;
    for (const char* name : {"tiny", "tiny-textured", "axes"}) {
      for (DecodeJob& job : jobsOf(conformance() / "scene" / name)) {
        all.push_back(std::move(job));
      }
    }
    SegmentMesh mesh;
    std::size_t before = 0;
    for (int round = 0; round < 4; ++round) {
      before = allocationCount();
      for (const DecodeJob& job : all) {
        if (!decodePayload(job, mesh).isOk()) {
          FAIL("does not decode");
        }
      }
    }
    CHECK(allocationCount() == before);
  }

  TEST_CASE("threads decode what they are given, and meshes come back for their memory") {
    const std::vector<DecodeJob> jobs = jobsOf(conformance() / "scene" / "axes");
    std::atomic<int> prepared{0};
    DecodeThreads queue(3, [&](SegmentMesh&, const SharedPayload& payload) { prepared += payload ? 1 : 0; }, 4);
    for (int round = 0; round < 20; ++round) {
      std::map<std::uint32_t, int> answers;
      for (std::uint32_t segment = 0; segment < jobs.size(); ++segment) {
        DecodeJob job = jobs[segment];
        job.epoch = 9;
        if (segment == 2) {
          job.payload = std::make_shared<const std::vector<std::uint8_t>>(40);
        }
        queue.push(std::move(job));
      }
      std::size_t count = 0;
      while (count < jobs.size()) {
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
      CHECK(answers.size() == jobs.size());
    }
    CHECK(prepared == 20 * static_cast<int>(jobs.size() - 1));
  }
}
