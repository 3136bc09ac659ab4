// Both encodings of the corpus' scenes, and memory that is used again.
#include <doctest/doctest.h>

#include <atomic>
#include <cstring>
#include <map>
#include <thread>

#include "FlatFile.h"
#include "LittleEndian.h"
#include "Terraport/DecodeThreads.h"
#include "Terraport/Json.h"
#include "Terraport/Xxh3.h"
#include "counting_new.h"
#include "mesh_arrays.h"
#include "test_files.h"

using namespace terraport;
using namespace terraport_tests;

namespace {

/// Payloads of one encoding of a scene, by its index.
std::vector<SharedPayload> payloadsOf(const std::filesystem::path& scene, const std::string& encoding) {
  const std::string text = readText(scene / "scene.json");
  JsonDocument document;
  REQUIRE(document.read(text).isOk());
  const JsonValue files = document.root().member("files");
  const auto fileOf = [&](const std::string& key) {
    const auto path = files.member(key).member("path").text();
    return path ? readFile(scene / std::string(*path)) : std::vector<std::uint8_t>();
  };
  const std::string stem = encoding == "glb" ? "segments" : "segments.arrays";
  const std::vector<std::uint8_t> pack = fileOf(stem + ".pack");
  const std::vector<std::uint8_t> index = fileOf(stem + ".idx");
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

void decodeInto(const SharedPayload& payload, std::uint32_t segment, PayloadEncoding encoding, SegmentMesh& mesh) {
  DecodeJob job;
  job.segment = segment;
  job.encoding = encoding;
  job.payload = payload;
  const Status status = decodePayload(job, mesh);
  REQUIRE_MESSAGE(status.isOk(), status.text());
}

template <typename T>
bool sameBits(const std::vector<T>& a, const std::vector<T>& b) {
  return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

}  // namespace

TEST_SUITE("payloads") {
  TEST_CASE("both encodings of a segment decode to the same arrays, bit for bit") {
    for (const char* name : {"tiny", "tiny-1.2", "axes"}) {
      CAPTURE(name);
      const std::vector<SharedPayload> glbs = payloadsOf(conformance() / "scene" / name, "glb");
      const std::vector<SharedPayload> flats = payloadsOf(conformance() / "scene" / name, "arrays");
      REQUIRE(glbs.size() == flats.size());
      for (std::uint32_t segment = 0; segment < glbs.size(); ++segment) {
        CAPTURE(segment);
        SegmentMesh glb;
        SegmentMesh flat;
        decodeInto(glbs[segment], segment, PayloadEncoding::Glb, glb);
        decodeInto(flats[segment], segment, PayloadEncoding::Arrays, flat);
        const MeshArrays a = arraysOf(glb);
        const MeshArrays b = arraysOf(flat);
        CHECK(sameBits(a.positions, b.positions));
        CHECK(sameBits(a.normals, b.normals));
        CHECK(sameBits(a.indices, b.indices));
        CHECK(sameBits(a.colours, b.colours));
        CHECK(sameBits(a.regionIds, b.regionIds));
        CHECK(sameBits(a.uvs, b.uvs));
        REQUIRE(a.attributes.size() == b.attributes.size());
        for (const auto& [attribute, values] : a.attributes) {
          // Which of the NaNs says "no value" has no meaning.
          const std::vector<float>& other = b.attributes.at(attribute);
          REQUIRE(values.size() == other.size());
          for (std::size_t at = 0; at < values.size(); ++at) {
            CHECK((values[at] == other[at] || (values[at] != values[at] && other[at] != other[at])));
          }
        }
        CHECK(std::memcmp(&glb.bounds, &flat.bounds, sizeof(Box)) == 0);
        CHECK(glb.segment == segment);
        REQUIRE(glb.image.bytes == flat.image.bytes);
        CHECK(std::memcmp(glbs[segment]->data() + glb.image.offset, flats[segment]->data() + flat.image.offset,
                          glb.image.bytes) == 0);
      }
    }
  }

  TEST_CASE("decoding allocates nothing once the buffers are large enough") {
    for (const PayloadEncoding encoding : {PayloadEncoding::Glb, PayloadEncoding::Arrays}) {
      std::vector<SharedPayload> all;
      for (const char* name : {"tiny", "tiny-1.2", "axes"}) {
        for (SharedPayload& payload :
             payloadsOf(conformance() / "scene" / name, encoding == PayloadEncoding::Glb ? "glb" : "arrays")) {
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
          job.encoding = encoding;
          job.payload = all[segment];
          if (!decodePayload(job, mesh).isOk()) {
            FAIL("does not decode");
          }
        }
      }
      CHECK(allocationCount() == before);
    }
  }

  TEST_CASE("a number of rows that is the largest there is, is no way to say none") {
    // Found by fuzzing: it stood for "any number" once.
    std::vector<std::uint8_t> file = readFile(conformance() / "scene" / "payload" / "good-full.arrays");
    for (std::size_t at = 40; at < 44; ++at) {
      file[at] = 0xff;
    }
    const std::uint64_t checksum = xxh3Hash64({file.data() + 16, file.size() - 16});
    std::memcpy(file.data() + 8, &checksum, 8);
    SegmentMesh mesh;
    DecodeJob job;
    job.encoding = PayloadEncoding::Arrays;
    job.payload = std::make_shared<const std::vector<std::uint8_t>>(file);
    CHECK_FALSE(decodePayload(job, mesh).isOk());
  }

  TEST_CASE("threads decode what they are given, and meshes come back for their memory") {
    const std::vector<SharedPayload> payloads = payloadsOf(conformance() / "scene" / "axes", "glb");
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
