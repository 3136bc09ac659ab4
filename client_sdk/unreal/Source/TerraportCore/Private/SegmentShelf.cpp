#include "SegmentShelf.h"

#include <algorithm>
#include <utility>

namespace terraport {
namespace {

/// How fast the guess of a segment's bytes follows what came.
constexpr double kGuessShare = 0.25;

/// At the renderer or on its way there, with memory of its own.
bool hasMemory(ShelfStep step) {
  return step == ShelfStep::Decoded || step == ShelfStep::Uploaded || step == ShelfStep::Drawable;
}

}  // namespace

bool InFlight::hasRoom() const {
  const double bytes = static_cast<double>(waitingBytes_) + static_cast<double>(decoding_ + 1) * guessBytes_;
  return count() == 0 || (count() < limits_.maxInFlight && bytes <= static_cast<double>(limits_.maxInFlightBytes));
}

void InFlight::wait(std::size_t bytes) {
  --decoding_;
  ++waiting_;
  waitingBytes_ += bytes;
  guessBytes_ += kGuessShare * (static_cast<double>(bytes) - guessBytes_);
}

void InFlight::leave(std::size_t bytes) {
  --waiting_;
  waitingBytes_ -= bytes;
}

void InFlight::clear() {
  decoding_ = 0;
  waiting_ = 0;
  waitingBytes_ = 0;
}

SegmentShelf::SegmentShelf(const ShelfLimits& limits, std::function<bool(std::uint32_t)> isNeeded)
    : limits_(limits), inFlight_(limits), isNeeded_(std::move(isNeeded)) {}

SegmentShelf::Entry* SegmentShelf::find(std::uint32_t segment) {
  const auto entry = entries_.find(segment);
  return entry == entries_.end() ? nullptr : &entry->second;
}

ShelfStep SegmentShelf::stepOf(std::uint32_t segment) const {
  const auto entry = entries_.find(segment);
  return entry == entries_.end() ? ShelfStep::Unknown : entry->second.step;
}

void SegmentShelf::setStep(std::uint32_t segment, Entry& entry, ShelfStep step) {
  if (step == ShelfStep::Decoded) {
    decoded_.insert(segment);
  } else if (entry.step == ShelfStep::Decoded) {
    decoded_.erase(segment);
  }
  entry.step = step;
  ++revision_;
}

bool SegmentShelf::hold(std::uint32_t segment, std::int64_t aimedDuring) {
  Entry* const entry = find(segment);
  if (entry == nullptr) {
    Entry added;
    added.aimedDuring = aimedDuring;
    added.usedAt = ++tick_;
    entries_.emplace(segment, added);
    ++revision_;
    return false;
  }
  entry->aimedDuring = std::max(entry->aimedDuring, aimedDuring);
  return entry->step == ShelfStep::Failed;
}

void SegmentShelf::forgive(std::uint32_t segment) {
  Entry* const entry = find(segment);
  if (entry != nullptr && entry->step == ShelfStep::Failed) {
    setStep(segment, *entry, ShelfStep::Held);
  }
}

void SegmentShelf::drop(std::uint32_t segment) {
  Entry* const entry = find(segment);
  if (entry == nullptr) {
    return;
  }
  if (entry->step == ShelfStep::Held && isNeeded_(segment)) {
    setStep(segment, *entry, ShelfStep::Failed);
  } else if (entry->step == ShelfStep::Held || entry->step == ShelfStep::Failed) {
    entries_.erase(segment);
    ++revision_;
  }
}

void SegmentShelf::clear() {
  entries_.clear();
  decoded_.clear();
  toFree_.clear();
  inFlight_.clear();
  spareBytes_ = 0;
  ++revision_;
}

bool SegmentShelf::tryDecode(std::uint32_t segment) {
  Entry* const entry = find(segment);
  if (entry == nullptr || entry->step != ShelfStep::Held || !inFlight_.hasRoom()) {
    return false;
  }
  setStep(segment, *entry, ShelfStep::Decoding);
  inFlight_.ask();
  return true;
}

bool SegmentShelf::take(std::uint32_t segment, std::size_t bytes) {
  Entry* const entry = find(segment);
  if (entry == nullptr || entry->step != ShelfStep::Decoding) {
    return false;
  }
  const bool isNeeded = isNeeded_(segment);
  if (!isNeeded && (entry->aimedDuring < 0 || spareBytes_ + bytes > limits_.spareBytes)) {
    setStep(segment, *entry, ShelfStep::Held);
    inFlight_.dismiss();
    return false;
  }
  setStep(segment, *entry, ShelfStep::Decoded);
  entry->bytes = bytes;
  entry->usedAt = ++tick_;
  inFlight_.wait(bytes);
  spareBytes_ += isNeeded ? 0 : bytes;
  return true;
}

void SegmentShelf::fail(std::uint32_t segment) {
  Entry* const entry = find(segment);
  if (entry == nullptr) {
    return;
  }
  if (entry->step == ShelfStep::Decoding) {
    inFlight_.dismiss();
    setStep(segment, *entry, ShelfStep::Failed);
  } else if (entry->step == ShelfStep::Decoded) {
    inFlight_.leave(entry->bytes);
    setStep(segment, *entry, ShelfStep::Failed);
    trim();
  }
}

void SegmentShelf::uploaded(std::uint32_t segment) {
  Entry* const entry = find(segment);
  if (entry != nullptr && entry->step == ShelfStep::Decoded) {
    setStep(segment, *entry, ShelfStep::Uploaded);
    inFlight_.leave(entry->bytes);
  }
}

void SegmentShelf::drawable(std::uint32_t segment) {
  Entry* const entry = find(segment);
  if (entry != nullptr && entry->step == ShelfStep::Uploaded) {
    setStep(segment, *entry, ShelfStep::Drawable);
  }
}

void SegmentShelf::freeUnneededMeshes() {
  freeIf([this](std::uint32_t segment, const Entry& entry) {
    return entry.step == ShelfStep::Decoded && entry.aimedDuring < 0 && !isNeeded_(segment);
  });
}

void SegmentShelf::freeLeftBehind(std::int64_t landing, const std::unordered_set<std::uint32_t>& hidden) {
  freeIf([&](std::uint32_t segment, const Entry& entry) {
    return !isNeeded_(segment) && (hidden.count(segment) != 0 || entry.aimedDuring < landing);
  });
}

bool SegmentShelf::isAimedSince(std::uint32_t segment, std::int64_t landing) const {
  const auto entry = entries_.find(segment);
  return entry != entries_.end() && entry->second.aimedDuring >= landing;
}

std::vector<std::uint32_t> SegmentShelf::takeFreed() {
  return std::exchange(toFree_, {});
}

void SegmentShelf::trim() {
  std::vector<std::pair<std::uint64_t, std::uint32_t>> spare;
  spareBytes_ = 0;
  for (const auto& [segment, entry] : entries_) {
    if (hasMemory(entry.step) && !isNeeded_(segment)) {
      spare.emplace_back(entry.usedAt, segment);
      spareBytes_ += entry.bytes;
    }
  }
  if (spareBytes_ <= limits_.spareBytes) {
    return;
  }
  std::sort(spare.begin(), spare.end());
  for (const auto& [usedAt, segment] : spare) {
    if (spareBytes_ <= limits_.spareBytes) {
      break;
    }
    Entry& entry = entries_[segment];
    spareBytes_ -= entry.bytes;
    free(segment, entry);
  }
}

template <typename IsToGo>
void SegmentShelf::freeIf(IsToGo&& isToGo) {
  for (auto& [segment, entry] : entries_) {
    if (hasMemory(entry.step) && isToGo(segment, entry)) {
      free(segment, entry);
    }
  }
  trim();
}

void SegmentShelf::free(std::uint32_t segment, Entry& entry) {
  if (entry.step == ShelfStep::Decoded) {
    inFlight_.leave(entry.bytes);
  }
  setStep(segment, entry, ShelfStep::Held);  // The payload is still here.
  toFree_.push_back(segment);
}

}  // namespace terraport
