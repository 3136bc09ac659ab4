#include <doctest/doctest.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>

#include "DiskCache.h"
#include "SegmentFile.h"
#include "Terraport/Xxh3.h"
#include "test_files.h"

namespace terraport_tests {
namespace {

namespace fs = std::filesystem;
using terraport::CachedSegment;
using terraport::DiskCache;

const std::string kUrl = "http://127.0.0.1:1/scenes/quarry";
constexpr std::uint64_t kBound = 1 << 20;

CachedSegment entryOf(std::uint32_t segment, std::size_t length, std::uint64_t seed) {
  Chance chance(seed + 1);
  auto payload = std::make_shared<std::vector<std::uint8_t>>(length);
  for (std::uint8_t& byte : *payload) {
    byte = static_cast<std::uint8_t>(chance.below(256));
  }
  CachedSegment entry;
  entry.facts.segment = segment;
  entry.facts.length = static_cast<std::uint32_t>(length);
  entry.facts.xxh3 = terraport::xxh3Hash64(terraport::viewOf(*payload));
  entry.facts.faces = 12;
  entry.facts.vertices = 9;
  entry.facts.bounds = {-1.0F, 0.0F, 2.0F, 3.0F, 4.0F, 5.0F};
  entry.payload = std::move(payload);
  return entry;
}

/// A folder that is gone with the test.
class Folder {
 public:
  Folder() {
    static int count = 0;
    const auto ticks = std::chrono::steady_clock::now().time_since_epoch().count();
    path = fs::temp_directory_path() / ("terraport-disk-" + std::to_string(ticks) + "-" + std::to_string(count++));
  }
  ~Folder() {
    std::error_code error;
    fs::remove_all(path, error);
  }

  DiskCache open(std::uint64_t bound = kBound) const { return DiskCache(path.string(), kUrl, bound); }

  std::vector<CachedSegment> restored(std::uint64_t mostBytes = kBound) const {
    return open().restore(mostBytes, [] { return false; });
  }

  std::vector<std::uint32_t> ids(std::uint64_t mostBytes = kBound) const {
    std::vector<std::uint32_t> segments;
    for (const CachedSegment& entry : restored(mostBytes)) {
      segments.push_back(entry.facts.segment);
    }
    return segments;
  }

  std::vector<fs::path> files() const {
    std::vector<fs::path> all;
    for (const auto& entry : fs::recursive_directory_iterator(path)) {
      if (entry.path().extension() == ".segment-2") {
        all.push_back(entry.path());
      }
    }
    std::sort(all.begin(), all.end());
    return all;
  }

  void age(const CachedSegment& entry, int seconds) const {
    const std::string name = terraport::segmentFileName(entry.facts.segment, entry.facts.xxh3);
    for (const fs::path& file : files()) {
      if (file.filename() == name) {
        fs::last_write_time(file, fs::file_time_type::clock::now() - std::chrono::seconds(seconds));
      }
    }
  }

  fs::path path;
};

void rewrite(const fs::path& path, const std::vector<std::uint8_t>& bytes) {
  std::ofstream(path, std::ios::binary).write(reinterpret_cast<const char*>(bytes.data()), std::streamsize(bytes.size()));
}

void flip(const fs::path& path, std::size_t at) {
  std::vector<std::uint8_t> bytes = readFile(path);
  bytes[at % bytes.size()] ^= 1;
  rewrite(path, bytes);
}

bool has(const std::vector<std::uint32_t>& ids, std::uint32_t segment) {
  return std::find(ids.begin(), ids.end(), segment) != ids.end();
}

}  // namespace

TEST_CASE("what was put on disk is restored by another cache of the scene") {
  const Folder folder;
  const CachedSegment entry = entryOf(7, 1000, 1);
  CHECK(folder.open().put(entry));
  const std::vector<CachedSegment> restored = folder.restored();
  REQUIRE(restored.size() == 1);
  CHECK(restored[0].facts.segment == 7);
  CHECK(restored[0].facts.xxh3 == entry.facts.xxh3);
  CHECK(restored[0].facts.bounds.maxZ == 5.0F);
  CHECK(*restored[0].payload == *entry.payload);
  CHECK(DiskCache(folder.path.string(), kUrl + "2", kBound).restore(kBound, [] { return false; }).empty());
}

TEST_CASE("damaged files are dropped from the disk") {
  const Folder folder;
  DiskCache cache = folder.open();
  for (std::uint32_t segment = 0; segment < 6; ++segment) {
    CHECK(cache.put(entryOf(segment, 500, segment)));
  }
  const std::vector<fs::path> files = folder.files();
  flip(files[0], 0);
  flip(files[1], 20);
  flip(files[2], 563);
  fs::resize_file(files[3], 300);
  fs::resize_file(files[4], 3);
  CHECK(folder.restored().size() == 1);
  CHECK(folder.files() == std::vector<fs::path>{files[5]});
}

TEST_CASE("the disk keeps its bound, and what was used last") {
  const Folder folder;
  DiskCache cache = folder.open(10 * 1064);
  std::vector<CachedSegment> entries;
  for (std::uint32_t segment = 0; segment < 10; ++segment) {
    entries.push_back(entryOf(segment, 1000, segment));
    CHECK(cache.put(entries.back()));
    folder.age(entries.back(), 100 - static_cast<int>(segment));
  }
  cache.use(entries[0].facts);
  CHECK(cache.put(entryOf(10, 1000, 10)));
  std::uintmax_t bytes = 0;
  for (const fs::path& file : folder.files()) {
    bytes += fs::file_size(file);
  }
  CHECK(bytes <= 10 * 1064);
  const std::vector<std::uint32_t> ids = folder.ids();
  CHECK(has(ids, 0));
  CHECK(has(ids, 9));
  CHECK(has(ids, 10));
  CHECK_FALSE(has(ids, 1));
  CHECK_FALSE(cache.put(entryOf(11, 20000, 11)));
}

TEST_CASE("of the disk the newest come first, up to the bytes that are asked for") {
  const Folder folder;
  DiskCache cache = folder.open();
  for (std::uint32_t segment = 0; segment < 5; ++segment) {
    const CachedSegment entry = entryOf(segment, 1000, segment);
    CHECK(cache.put(entry));
    folder.age(entry, 100 - static_cast<int>(segment));
  }
  CHECK(folder.ids(2500) == std::vector<std::uint32_t>{4, 3});
  CHECK(folder.open().restore(kBound, [] { return true; }).empty());
}

TEST_CASE("of two versions on disk the newer counts") {
  const Folder folder;
  DiskCache cache = folder.open();
  const CachedSegment older = entryOf(3, 1000, 1);
  CHECK(cache.put(older));
  folder.age(older, 50);
  const CachedSegment newer = entryOf(3, 1200, 2);
  CHECK(cache.put(newer));
  const std::vector<CachedSegment> restored = folder.restored();
  REQUIRE(restored.size() == 1);
  CHECK(restored[0].facts.xxh3 == newer.facts.xxh3);
  CHECK(folder.files().size() == 1);
}

TEST_CASE("what is not ours stays on disk") {
  const Folder folder;
  const fs::path foreign = folder.path / "photos" / "1-0123456789abcdef.segment-2";
  fs::create_directories(foreign.parent_path());
  rewrite(foreign, std::vector<std::uint8_t>(5000));
  DiskCache cache = folder.open(3000);
  for (std::uint32_t segment = 0; segment < 5; ++segment) {
    CHECK(cache.put(entryOf(segment, 1000, segment)));
  }
  CHECK(fs::exists(foreign));
}

TEST_CASE("a folder that cannot be written is no error") {
  const Folder folder;
  rewrite(folder.path, {1, 2, 3});
  CHECK(folder.restored().empty());
  DiskCache cache = folder.open();
  CHECK_FALSE(cache.put(entryOf(1, 100, 1)));
  cache.use(entryOf(1, 100, 1).facts);
}

}  // namespace terraport_tests
