#include "SessionAssembly.h"

#include <string>

namespace terraport {

Status Assembler::take(const PayloadFrame& frame, std::uint32_t length, SharedPayload& payload) {
  const auto violation = [&frame](const std::string& text) {
    return Status::failed("malformed", "segment " + std::to_string(frame.segment) + text);
  };
  if (frame.total != length) {
    return violation(
        " announces " + std::to_string(frame.total) + " bytes, expected " + std::to_string(length) + " by the plan");
  }
  const std::uint8_t* const begin = frame.chunk.data;
  const std::uint8_t* const end = begin + frame.chunk.size;
  const auto partial = partials_.find(frame.segment);
  const std::size_t received = partial == partials_.end() ? 0 : partial->second.size();
  if (frame.offset != received) {
    return violation(" continues at byte " + std::to_string(frame.offset) + ", expected " + std::to_string(received));
  }
  if (frame.isLast && received == 0) {
    payload = std::make_shared<const std::vector<std::uint8_t>>(begin, end);
    return Status::ok();
  }
  std::vector<std::uint8_t>& buffer = partials_[frame.segment];
  buffer.insert(buffer.end(), begin, end);
  if (!frame.isLast) return Status::ok();
  // A copy of the exact size: the buffer has grown beyond it, and payloads are kept for long.
  payload = std::make_shared<const std::vector<std::uint8_t>>(buffer.begin(), buffer.end());
  partials_.erase(frame.segment);
  return Status::ok();
}

void Assembler::keepOnly(const std::map<std::uint32_t, SegmentFacts>& segments) {
  for (auto partial = partials_.begin(); partial != partials_.end();) {
    partial = segments.count(partial->first) != 0 ? std::next(partial) : partials_.erase(partial);
  }
}

}  // namespace terraport
