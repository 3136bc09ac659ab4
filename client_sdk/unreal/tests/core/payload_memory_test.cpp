// Payloads of the corpus' scenes, and memory that is used again.
#include <doctest/doctest.h>

#include <atomic>
#include <map>
#include <thread>

#include "FlatFile.h"
#include "LittleEndian.h"
#include "Terraport/DecodeThreads.h"
#include "Terraport/Json.h"
#include "Terraport/Xxh3.h"
#include "counting_new.h"
#include "test_files.h"

using namespace terraport;
using namespace terraport_tests;

namespace {

/// Payloads of a scene, by its index.
std::vector<SharedPayload> payloadsOf(const std::filesystem::path& scene) {
  const std::string text = readText(scene / "scene.json");
  JsonDocument document;
  REQUIRE(document.read(text).isOk());
  const JsonValue files = document.root().member("files");
  const auto fileOf = [&](const std::string& key) {
    const auto path = files.member(key).member("path").text();
    return path ? readFile(scene / std::string(*path)) : std::vector<std::uint8_t>();
  };
  const std::vector<std::uint8_t> pack = fileOf("segments.pack");
  const std::vector<std::uint8_t> index = fileOf("segments.idx");
  FlatFile flat;
  REQUIRE(flat.read(viewOf(index), "TPSEGIDX").isOk());
  const FlatField* offsets = flat.find("offset");
  const FlatField* lengths = flat.find("length");
  const FlatField* hashes = flat.find("xxh3");
  REQUIRE((offsets != nullptr && lengths != nullptr && hashes != nullptr));
  std::vector<SharedPayload> payloads;
  for (std::uint32_t row = 0; row < flat.rows(); ++row) {
    const auto first = pack.begin() + static_cast<std::ptrdiff_t>(readU64(offsets->bytes.data + row * std::size_t{8}));
    const std::uint32_t length = readU32(lengths->bytes.data + row * std::size_t{4});
    auto bytes = std::make_shared<std::vector<std::uint8_t>>(first, first + static_cast<std::ptrdiff_t>(length));
    CHECK(xxh3Hash64(viewOf(*bytes)) == readU64(hashes->bytes.data + row * std::size_t{8}));
    payloads.push_back(std::move(bytes));
  }
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
