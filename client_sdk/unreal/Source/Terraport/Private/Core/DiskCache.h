// Payloads on disk: FOLDER/<key: 16 hex>-<box: 48 hex>-<scene: 8 hex>.segment. The name says what is near without opening a
// file, and payloads have checksums of their own. Bounded in bytes; the least recently used go first. Nothing is synced: what a
// crash leaves behind fails its checksum and is asked for again.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <mutex>
#include <string>

#include "Core/Cache.h"

namespace terraport {

/// Thread-safe: worker threads read and write.
class DiskCache {
 public:
  /// `folder` is UTF-8, made when something is written, and shared by all scenes, as the bound is. With 0 bytes nothing is read
  /// or written.
  DiskCache(const std::string& folder, const std::string& sceneUrl, std::uint64_t maxBytes);

  /// What is there of this scene. Looks at names alone.
  std::map<Key, Box> list();

  /// Null where the file is gone.
  SharedBytes read(Key key, const Box& box);

  /// Write a payload; returns the keys that were deleted for it, and whether it was written. A folder that cannot be written is
  /// not tried again.
  bool write(const CachedSegment& entry, Keys& removed);

  void remove(Key key, const Box& box);

 private:
  struct File {
    std::filesystem::path path;
    std::uint64_t bytes = 0;
    std::filesystem::file_time_type usedAt;
    Key key = 0;
    Box box;
    bool isOfScene = false;
  };

  std::vector<File> scan();
  std::filesystem::path pathOf(Key key, const Box& box) const;

  const std::filesystem::path folder_;
  /// Behind the box in a file's name.
  const std::string ending_;
  const std::uint64_t maxBytes_;
  std::mutex mutex_;
  /// By the mutex alone.
  std::uint64_t bytes_ = 0;
  bool isScanned_ = false;
  bool isWritable_ = true;
  std::uint64_t written_ = 0;
};

}  // namespace terraport
