// terraport-decode FILE [--seconds S]
//
// How fast payloads are decoded, and how often memory is asked for. The file holds the scene's attributes, as
// JSON, and payloads, each after its length (uint32, little-endian).

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <new>
#include <string>
#include <vector>

#include "Terraport/DecodeQueue.h"
#include "Terraport/Json.h"
#include "Terraport/SegmentMesh.h"
#include "files.h"
#include "json_text.h"

namespace {

std::uint64_t allocations = 0;
std::uint64_t allocatedBytes = 0;

void* counted(std::size_t size) {
  ++allocations;
  allocatedBytes += size;
  void* memory = std::malloc(size == 0 ? 1 : size);
  if (memory == nullptr) {
    std::abort();
  }
  return memory;
}

}  // namespace

void* operator new(std::size_t size) {
  return counted(size);
}
void* operator new[](std::size_t size) {
  return counted(size);
}
void* operator new(std::size_t size, const std::nothrow_t&) noexcept {
  return counted(size);
}
void* operator new[](std::size_t size, const std::nothrow_t&) noexcept {
  return counted(size);
}
void operator delete(void* memory) noexcept {
  std::free(memory);
}
void operator delete[](void* memory) noexcept {
  std::free(memory);
}
void operator delete(void* memory, std::size_t) noexcept {
  std::free(memory);
}
void operator delete[](void* memory, std::size_t) noexcept {
  std::free(memory);
}

namespace {

/// Rounds over all payloads before anything is measured: buffers grow.
constexpr int kWarmUpRounds = 2;

std::vector<terraport::DecodeJob> readJobs(const std::string& path) {
  using namespace terraport;
  const std::vector<std::uint8_t> bytes = tools::readFile(path);
  SharedSceneFiles files;
  std::vector<DecodeJob> jobs;
  for (std::size_t at = 0; at + 4 <= bytes.size();) {
    const std::size_t size = bytes[at] | bytes[at + 1] << 8 | bytes[at + 2] << 16 | std::size_t{bytes[at + 3]} << 24;
    at += 4;
    if (!files) {
      JsonDocument attributes;
      const Status status = attributes.read({reinterpret_cast<const char*>(&bytes[at]), size});
      files = tools::filesWith(status.isOk() ? attributes.root() : JsonValue());
      at += size;
      continue;
    }
    DecodeJob job;
    job.payload = std::make_shared<const std::vector<std::uint8_t>>(
        bytes.begin() + static_cast<std::ptrdiff_t>(at), bytes.begin() + static_cast<std::ptrdiff_t>(at + size));
    job.files = files;
    jobs.push_back(std::move(job));
    at += size;
  }
  return jobs;
}

}  // namespace

int main(int count, char** arguments) {
  using namespace terraport;
  if (count != 2 && count != 4) {
    std::fprintf(stderr, "usage: terraport-decode FILE [--seconds S]\n");
    return 2;
  }
  // 1. Payloads, and rounds until no buffer grows any more.
  const double seconds = count == 4 ? std::atof(arguments[3]) : 2.0;
  const std::vector<DecodeJob> jobs = readJobs(arguments[1]);
  SegmentMesh mesh;
  double bytes = 0.0;
  double faces = 0.0;
  for (int round = 0; round < kWarmUpRounds; ++round) {
    bytes = faces = 0.0;
    for (const DecodeJob& job : jobs) {
      const Status status = decodePayload(job, mesh);
      if (!status.isOk()) {
        std::fprintf(stderr, "error: %s\n", status.text().c_str());
        return 1;
      }
      bytes += static_cast<double>(job.payload->size());
      faces += mesh.faceCount;
    }
  }
  // 2. Rounds against the clock; allocations are counted from here.
  using Clock = std::chrono::steady_clock;
  const std::uint64_t allocationsBefore = allocations;
  const std::uint64_t bytesBefore = allocatedBytes;
  const Clock::time_point start = Clock::now();
  double elapsed = 0.0;
  std::uint64_t rounds = 0;
  std::uint64_t failures = 0;
  do {
    for (const DecodeJob& job : jobs) {
      failures += decodePayload(job, mesh).isOk() ? 0 : 1;
    }
    ++rounds;
    elapsed = std::chrono::duration<double>(Clock::now() - start).count();
  } while (elapsed < seconds);
  // 3. The result.
  const std::uint64_t allocated = allocations - allocationsBefore;
  const std::uint64_t allocatedInAll = allocatedBytes - bytesBefore;
  const double decoded = static_cast<double>(rounds) * static_cast<double>(jobs.size());
  tools::JsonText json;
  json.open('{').key("segments").number(decoded).key("seconds").number(elapsed);
  json.key("segments_per_s").number(decoded / elapsed);
  json.key("payload_mb_per_s").number(static_cast<double>(rounds) * bytes / 1e6 / elapsed);
  json.key("mtriangles_per_s").number(static_cast<double>(rounds) * faces / 1e6 / elapsed);
  json.key("allocations").integer(static_cast<std::int64_t>(allocated));
  json.key("allocated_bytes").integer(static_cast<std::int64_t>(allocatedInAll));
  json.key("allocated_bytes_per_segment").number(static_cast<double>(allocatedInAll) / decoded);
  // The payloads themselves were counted: a meter that stands still proves nothing.
  json.key("meter_saw_bytes").integer(static_cast<std::int64_t>(bytesBefore));
  json.key("failures").integer(static_cast<std::int64_t>(failures)).close('}');
  std::printf("%s\n", json.str().c_str());
  return failures == 0 ? 0 : 1;
}
