#include "Terraport/MessageAssembler.h"

#include <utility>

namespace terraport {

namespace {

/// Buffers that are kept for later messages, and how large one may be for that.
constexpr std::size_t kMostSpare = 16;
constexpr std::size_t kMostSpareBytes = 256 * 1024;

}  // namespace

Status MessageAssembler::take(ByteSpan fragment, bool isText, bool isLast) {
  if (!inMessage_) {
    inMessage_ = true;
    assembling_.isText = isText;
    assembling_.bytes.clear();
    if (!spare_.empty()) {
      assembling_.bytes.swap(spare_.back());
      spare_.pop_back();
      assembling_.bytes.clear();
    }
  } else if (assembling_.isText != isText) {
    return Status::failed("malformed", "got a message that is text and binary");
  }
  if (fragment.size > limits_.maxMessageBytes - assembling_.bytes.size()) {
    return Status::failed("too_large", "got a message of more than " + std::to_string(limits_.maxMessageBytes) + " bytes");
  }
  assembling_.bytes.insert(assembling_.bytes.end(), fragment.data, fragment.data + fragment.size);
  if (!isLast) return Status::ok();
  inMessage_ = false;
  if (!whole_.empty() && waitingBytes_ + assembling_.bytes.size() > limits_.maxWaitingBytes) {
    return Status::failed("too_large", "more than " + std::to_string(limits_.maxWaitingBytes) + " bytes wait to be read");
  }
  waitingBytes_ += assembling_.bytes.size();
  whole_.push_back(std::exchange(assembling_, TransportMessage()));
  return Status::ok();
}

bool MessageAssembler::tryNext(TransportMessage& message) {
  if (whole_.empty()) return false;
  std::swap(message, whole_.front());
  std::vector<std::uint8_t>& buffer = whole_.front().bytes;
  if (buffer.capacity() > 0 && buffer.capacity() <= kMostSpareBytes && spare_.size() < kMostSpare)
    spare_.push_back(std::move(buffer));
  whole_.pop_front();
  waitingBytes_ -= message.bytes.size();
  return true;
}

void MessageAssembler::clear() {
  inMessage_ = false;
  assembling_.bytes.clear();
  whole_.clear();
  waitingBytes_ = 0;
}

}  // namespace terraport
