#include "Core/DiskCache.h"

#include <zlib.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <fstream>
#include <optional>
#include <random>
#include <system_error>
#include <utility>

namespace terraport {
namespace {

namespace fs = std::filesystem;

constexpr char kEnding[] = ".segment";
constexpr char kTemporaryEnding[] = ".tmp";
constexpr std::size_t kNameBytes = 16 + 1 + 48 + 1 + 8 + 8;
/// Age after which a temporary file belongs to a process that died.
constexpr auto kStale = std::chrono::hours(1);

fs::path pathOfUtf8(const std::string& text) {
#if defined(__cpp_char8_t)
  return fs::path(std::u8string(text.begin(), text.end()));
#else
  return fs::u8path(text);
#endif
}

bool endsWith(const std::string& text, const std::string& ending) {
  return text.size() >= ending.size() && text.compare(text.size() - ending.size(), ending.size(), ending) == 0;
}

std::string nameOf(Key key, const Box& box) {
  std::string name = hexOf(key) + "-";
  for (const float* corner : {box.low, box.high}) {
    for (int axis = 0; axis < 3; ++axis) {
      std::uint32_t bits = 0;
      std::memcpy(&bits, &corner[axis], sizeof bits);
      name += hexOf(bits).substr(8);
    }
  }
  return name;
}

std::optional<std::uint64_t> numberOf(const std::string& digits) {
  std::uint64_t number = 0;
  for (const char digit : digits) {
    const std::size_t value = std::string("0123456789abcdef").find(digit);
    if (value == std::string::npos) return std::nullopt;
    number = 16 * number + value;
  }
  return number;
}

bool readName(const std::string& name, Key& key, Box& box) {
  if (name.size() != kNameBytes || name[16] != '-' || !endsWith(name, kEnding)) return false;
  const auto number = numberOf(name.substr(0, 16));
  if (!number) return false;
  key = *number;
  for (std::size_t at = 0; at < 6; ++at) {
    const auto bits = numberOf(name.substr(17 + 8 * at, 8));
    if (!bits) return false;
    const auto word = static_cast<std::uint32_t>(*bits);
    std::memcpy(at < 3 ? &box.low[at] : &box.high[at - 3], &word, sizeof word);
  }
  return true;
}

}  // namespace

DiskCache::DiskCache(const std::string& folder, const std::string& sceneUrl, std::uint64_t maxBytes)
    : folder_(pathOfUtf8(folder)),
      ending_("-" +
          hexOf(crc32(0, reinterpret_cast<const Bytef*>(sceneUrl.data()), static_cast<uInt>(sceneUrl.size()))).substr(8) +
          kEnding),
      maxBytes_(maxBytes),
      written_(std::random_device{}()) {}

std::map<Key, Box> DiskCache::list() {
  std::map<Key, Box> found;
  if (maxBytes_ == 0) return found;
  const std::lock_guard<std::mutex> lock(mutex_);
  for (const File& file : scan()) {
    if (file.isOfScene) found.emplace(file.key, file.box);
  }
  return found;
}

SharedBytes DiskCache::read(Key key, const Box& box) {
  const fs::path path = pathOf(key, box);
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  const std::streamoff size = file ? static_cast<std::streamoff>(file.tellg()) : -1;
  if (size < 0) return nullptr;
  auto payload = std::make_shared<Bytes>(static_cast<std::size_t>(size));
  file.seekg(0);
  if (!file.read(reinterpret_cast<char*>(payload->data()), size)) return nullptr;
  file.close();
  std::error_code error;
  fs::last_write_time(path, fs::file_time_type::clock::now(), error);  // Used now.
  return payload;
}

bool DiskCache::write(const CachedSegment& entry, Keys& removed) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const std::uint64_t needed = entry.payload->size();
  if (!isWritable_ || needed > maxBytes_) return false;
  std::error_code error;
  const fs::path path = pathOf(entry.key, entry.box);
  if (fs::exists(path, error)) return true;
  if (!isScanned_) scan();
  if (bytes_ + needed > maxBytes_) {
    // Down to nine tenths, so that not every write scans the folder.
    for (const File& file : scan()) {
      if (bytes_ + needed <= maxBytes_ / 10 * 9) break;
      if (fs::remove(file.path, error)) {
        bytes_ -= file.bytes;
        removed.push_back(file.key);
      }
    }
  }
  fs::create_directories(folder_, error);
  const fs::path temporary = folder_ / (hexOf(++written_) + kTemporaryEnding);
  {
    std::ofstream file(temporary, std::ios::binary | std::ios::trunc);
    file.write(reinterpret_cast<const char*>(entry.payload->data()), static_cast<std::streamsize>(needed));
    file.close();
    isWritable_ = !file.fail();
  }
  if (isWritable_) {
    fs::rename(temporary, path, error);
    isWritable_ = !error;
  }
  if (!isWritable_) {
    fs::remove(temporary, error);
    return false;
  }
  bytes_ += needed;
  return true;
}

void DiskCache::remove(Key key, const Box& box) {
  std::error_code error;
  const fs::path path = pathOf(key, box);
  const std::lock_guard<std::mutex> lock(mutex_);
  const std::uintmax_t size = fs::file_size(path, error);
  if (!error && fs::remove(path, error)) bytes_ -= std::min<std::uint64_t>(bytes_, size);
}

/// All payloads, the least recently used first; counts the bytes.
std::vector<DiskCache::File> DiskCache::scan() {
  std::vector<File> files;
  std::error_code error;
  bytes_ = 0;
  isScanned_ = true;
  for (fs::directory_iterator at(folder_, error); !error && at != fs::directory_iterator(); at.increment(error)) {
    const std::string name = at->path().filename().string();
    File file;
    std::error_code gone;  // Another process may delete it meanwhile.
    file.path = at->path();
    file.bytes = at->file_size(gone);
    file.usedAt = at->last_write_time(gone);
    if (gone) continue;
    if (readName(name, file.key, file.box)) {
      file.isOfScene = endsWith(name, ending_);
      bytes_ += file.bytes;
      files.push_back(std::move(file));
    } else if (endsWith(name, kTemporaryEnding) && fs::file_time_type::clock::now() - file.usedAt > kStale) {
      fs::remove(file.path, gone);
    }
  }
  std::sort(files.begin(), files.end(), [](const File& a, const File& b) { return a.usedAt < b.usedAt; });
  return files;
}

fs::path DiskCache::pathOf(Key key, const Box& box) const {
  return folder_ / (nameOf(key, box) + ending_);
}

}  // namespace terraport
