#include "DiskShelf.h"

#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <thread>
#include <utility>

namespace terraport {
namespace {

/// A visit begins after so long at the latest, with what was read by then.
constexpr auto kRestore = std::chrono::milliseconds(1500);

/// Payloads that wait to be written.
constexpr std::uint64_t kMaxWaitingBytes = std::uint64_t{32} * 1024 * 1024;

/// As many as two landings may show; one that is left out only goes a little sooner.
constexpr std::size_t kMaxUses = std::size_t{2} * 65536;

}  // namespace

struct DiskShelf::Impl {
  Impl(DiskCache cache_, std::uint64_t mostBytes) : cache(std::move(cache_)) {
    thread = std::thread([this, mostBytes] { run(mostBytes); });
  }

  ~Impl() {
    {
      const std::lock_guard<std::mutex> lock(mutex);
      isClosed = true;
    }
    wake.notify_one();
    thread.join();
  }

  void run(std::uint64_t mostBytes) {
    const auto end = std::chrono::steady_clock::now() + kRestore;
    std::vector<CachedSegment> entries = cache.restore(mostBytes, [this, end] {
      const std::lock_guard<std::mutex> lock(mutex);
      return isClosed || std::chrono::steady_clock::now() > end;
    });
    {
      const std::lock_guard<std::mutex> lock(mutex);
      restored = std::move(entries);
    }
    for (;;) {
      std::optional<CachedSegment> write;
      std::optional<SegmentFacts> used;
      {
        std::unique_lock<std::mutex> lock(mutex);
        wake.wait(lock, [this] { return isClosed || !writes.empty() || !uses.empty(); });
        if (isClosed) {
          return;
        }
        if (!writes.empty()) {
          write = std::move(writes.front());
          writes.pop_front();
        } else {
          used = uses.front();
          uses.pop_front();
        }
      }
      if (write) {
        cache.put(*write);
        const std::lock_guard<std::mutex> lock(mutex);
        waitingBytes -= write->payload->size();
      } else {
        cache.use(*used);
      }
    }
  }

  /// Of the thread alone.
  DiskCache cache;

  std::mutex mutex;
  std::condition_variable wake;
  // By the mutex alone.
  std::optional<std::vector<CachedSegment>> restored;
  std::deque<CachedSegment> writes;
  std::deque<SegmentFacts> uses;
  std::uint64_t waitingBytes = 0;
  bool isClosed = false;

  std::thread thread;
};

DiskShelf::DiskShelf(DiskCache cache, std::uint64_t mostBytes) : impl_(std::make_unique<Impl>(std::move(cache), mostBytes)) {}

DiskShelf::~DiskShelf() = default;

std::optional<std::vector<CachedSegment>> DiskShelf::takeRestored() {
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  return std::exchange(impl_->restored, std::nullopt);
}

void DiskShelf::put(CachedSegment entry) {
  {
    const std::lock_guard<std::mutex> lock(impl_->mutex);
    if (impl_->waitingBytes + entry.payload->size() > kMaxWaitingBytes) {
      return;
    }
    impl_->waitingBytes += entry.payload->size();
    impl_->writes.push_back(std::move(entry));
  }
  impl_->wake.notify_one();
}

void DiskShelf::use(const SegmentFacts& facts) {
  {
    const std::lock_guard<std::mutex> lock(impl_->mutex);
    if (impl_->uses.size() >= kMaxUses) {
      return;
    }
    impl_->uses.push_back(facts);
  }
  impl_->wake.notify_one();
}

}  // namespace terraport
