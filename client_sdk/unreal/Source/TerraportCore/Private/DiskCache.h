// Payloads on disk, from one run to the next, of all scenes in one folder.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "Cache.h"

namespace terraport {

/// Named by their hash, checked when they are read, written beside and renamed. Bounded in bytes; what was used longest ago
/// goes first. Nothing here fails: a disk that is full, damaged or read-only keeps less, or nothing.
///
///     FOLDER/<16 digits: XXH3-64 of the scene's URL>/<segment>-<16 digits: XXH3-64>.segment-2
///
/// Every method blocks. One thread at a time; several processes may share a folder.
class DiskCache {
 public:
  /// The cache of one scene. `root` is UTF-8.
  DiskCache(const std::string& root, const std::string& sceneUrl, std::uint64_t maxBytes);

  /// What is kept of the scene, used last first, until so many bytes are over or it `isLate`. Damaged files are deleted.
  std::vector<CachedSegment> restore(std::uint64_t mostBytes, const std::function<bool()>& isLate);

  /// Keep a payload, used just now; whether it is on disk.
  bool put(const CachedSegment& entry);

  /// Note that a payload was used, so that it goes last.
  void use(const SegmentFacts& facts);

 private:
  struct File {
    std::filesystem::path path;
    std::uint64_t bytes = 0;
    std::filesystem::file_time_type usedAt;
  };

  std::vector<File> look();
  void makeRoom(std::uint64_t needed);
  void remove(const File& file);
  bool read(const File& file, CachedSegment& entry);
  std::filesystem::path pathOf(const SegmentFacts& facts) const;

  const std::filesystem::path root_;
  const std::filesystem::path folder_;
  const std::uint64_t maxBytes_;
  /// Over all scenes, once the folder was looked at.
  std::uint64_t bytes_ = 0;
  bool isCounted_ = false;
  bool isWritable_ = true;
  /// Of temporary names: this process's, and how many.
  const std::string token_;
  std::uint64_t written_ = 0;
};

}  // namespace terraport
