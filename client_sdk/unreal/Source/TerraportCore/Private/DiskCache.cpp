#include "DiskCache.h"

#include <algorithm>
#include <chrono>
#include <fstream>
#include <random>
#include <set>
#include <system_error>
#include <utility>

#include "SegmentFile.h"
#include "Terraport/Xxh3.h"

namespace terraport {
namespace {

namespace fs = std::filesystem;

constexpr auto kStale = std::chrono::hours(1);
const std::string kBesideEnding = ".tmp";

fs::path pathOfUtf8(const std::string& text) {
#if defined(__cpp_char8_t)
  return fs::path(std::u8string(text.begin(), text.end()));
#else
  return fs::u8path(text);
#endif
}

std::string keyOf(const std::string& sceneUrl) {
  return hexOf(xxh3Hash64({reinterpret_cast<const std::uint8_t*>(sceneUrl.data()), sceneUrl.size()}));
}

bool isKey(const std::string& name) {
  return name.size() == 16 && name.find_first_not_of("0123456789abcdef") == std::string::npos;
}

bool isBeside(const std::string& name) {
  return name.size() > kBesideEnding.size() && name[0] == '.' &&
      name.compare(name.size() - kBesideEnding.size(), kBesideEnding.size(), kBesideEnding) == 0;
}

/// Visit a folder's entries until there are no more, or it cannot be read.
template <typename Visit>
void visitFolder(const fs::path& folder, Visit&& visit) {
  std::error_code error;
  for (fs::directory_iterator entry(folder, error); !error && entry != fs::directory_iterator(); entry.increment(error)) {
    visit(entry->path());
  }
}

}  // namespace

DiskCache::DiskCache(const std::string& root, const std::string& sceneUrl, std::uint64_t maxBytes)
    : root_(pathOfUtf8(root)), folder_(root_ / keyOf(sceneUrl)), maxBytes_(maxBytes), token_(hexOf([] {
        // Not every platform has a good random_device; the clock differs too.
        const auto ticks = static_cast<std::uint64_t>(std::chrono::steady_clock::now().time_since_epoch().count());
        return (std::uint64_t{std::random_device{}()} << 32) ^ ticks;
      }())) {}

std::vector<CachedSegment> DiskCache::restore(std::uint64_t mostBytes, const std::function<bool()>& isLate) {
  std::vector<CachedSegment> restored;
  std::set<std::uint32_t> segments;
  std::uint64_t total = 0;
  std::vector<File> files = look();
  for (auto file = files.rbegin(); file != files.rend() && !isLate(); ++file) {
    const auto segment = segmentOfFileName(file->path.filename().string());
    if (!segment || file->path.parent_path() != folder_) {
      continue;
    }
    // Of two versions of the scene: the one that was used last.
    if (!segments.insert(*segment).second) {
      remove(*file);
      continue;
    }
    if (total + file->bytes > mostBytes) {
      break;
    }
    CachedSegment entry;
    if (read(*file, entry)) {
      total += file->bytes;
      restored.push_back(std::move(entry));
    }
  }
  return restored;
}

bool DiskCache::put(const CachedSegment& entry) {
  const std::uint64_t needed = kSegmentHeadBytes + entry.payload->size();
  if (!isWritable_ || needed > maxBytes_) {
    return false;
  }
  const fs::path path = pathOf(entry.facts);
  std::error_code error;
  if (fs::exists(path, error)) {
    use(entry.facts);
    return true;
  }
  if (!isCounted_) {
    look();
  }
  if (bytes_ + needed > maxBytes_) {
    makeRoom(needed);
  }
  fs::create_directories(folder_, error);
  const fs::path beside = folder_ / ("." + token_ + "-" + std::to_string(written_++) + kBesideEnding);
  bool isWritten = false;
  {
    std::ofstream file(beside, std::ios::binary | std::ios::trunc);
    const std::vector<std::uint8_t> head = segmentHead(entry.facts);
    file.write(reinterpret_cast<const char*>(head.data()), static_cast<std::streamsize>(head.size()));
    file.write(reinterpret_cast<const char*>(entry.payload->data()), static_cast<std::streamsize>(entry.payload->size()));
    file.close();
    isWritten = !file.fail();
  }
  if (isWritten) {
    fs::rename(beside, path, error);
    isWritten = !error;
  }
  if (isWritten) {
    bytes_ += needed;
    return true;
  }
  // A folder that cannot be written is not asked again: each attempt would cost as much as a write.
  isWritable_ = false;
  fs::remove(beside, error);
  return false;
}

void DiskCache::use(const SegmentFacts& facts) {
  std::error_code error;
  if (isWritable_) {
    fs::last_write_time(pathOf(facts), fs::file_time_type::clock::now(), error);
  }
}

/// Every file of all scenes, used longest ago first; counts the bytes, and deletes what a process that died left behind. What
/// is not ours is left alone, whoever put it there.
std::vector<DiskCache::File> DiskCache::look() {
  std::vector<File> files;
  bytes_ = 0;
  isCounted_ = true;
  visitFolder(root_, [this, &files](const fs::path& scene) {
    if (!isKey(scene.filename().string())) {
      return;
    }
    visitFolder(scene, [this, &files](const fs::path& path) {
      const std::string name = path.filename().string();
      std::error_code error;
      File file{path, fs::file_size(path, error), {}};
      if (!error) {
        file.usedAt = fs::last_write_time(path, error);
      }
      if (error || !(isBeside(name) || segmentOfFileName(name))) {
        return;
      }
      if (isBeside(name) && fs::file_time_type::clock::now() - file.usedAt > kStale) {
        fs::remove(path, error);
        return;
      }
      bytes_ += file.bytes;
      files.push_back(std::move(file));
    });
  });
  std::sort(files.begin(), files.end(), [](const File& a, const File& b) { return a.usedAt < b.usedAt; });
  return files;
}

void DiskCache::makeRoom(std::uint64_t needed) {
  // Down to nine tenths, so that not every write looks at the folder.
  const std::uint64_t most = maxBytes_ / 10 * 9;
  for (const File& file : look()) {
    if (bytes_ + needed <= most) {
      return;
    }
    // Another process is writing it.
    if (!isBeside(file.path.filename().string())) {
      remove(file);
    }
  }
}

void DiskCache::remove(const File& file) {
  std::error_code error;
  if (fs::remove(file.path, error)) {
    bytes_ -= std::min(bytes_, file.bytes);
  }
}

/// Whole, and what its name says; else it is deleted.
bool DiskCache::read(const File& file, CachedSegment& entry) {
  std::ifstream stream(file.path, std::ios::binary);
  if (!stream) {
    return false;
  }
  std::uint8_t head[kSegmentHeadBytes];
  stream.read(reinterpret_cast<char*>(head), sizeof(head));
  const auto facts = stream ? readSegmentHead(head, file.bytes) : std::nullopt;
  if (facts && file.path.filename().string() == segmentFileName(facts->segment, facts->xxh3)) {
    auto payload = std::make_shared<std::vector<std::uint8_t>>(facts->length);
    stream.read(reinterpret_cast<char*>(payload->data()), static_cast<std::streamsize>(payload->size()));
    if (stream && xxh3Hash64(viewOf(*payload)) == facts->xxh3) {
      entry = CachedSegment{*facts, std::move(payload)};
      return true;
    }
  }
  stream.close();
  remove(file);
  return false;
}

fs::path DiskCache::pathOf(const SegmentFacts& facts) const {
  return folder_ / segmentFileName(facts.segment, facts.xxh3);
}

}  // namespace terraport
