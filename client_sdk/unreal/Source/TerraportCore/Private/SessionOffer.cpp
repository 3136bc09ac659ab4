#include "SessionOffer.h"

#include <algorithm>

namespace terraport {

namespace {

/// Bytes of one row of a held table.
constexpr std::uint64_t kRowBytes = 12;

/// Room for what stands around the table in its message.
constexpr std::uint64_t kAroundBytes = 64;

}  // namespace

std::vector<HeldRow> HeldOffer::first(std::vector<HeldRow> rows, bool isInHello) {
  const std::size_t count = isInHello ? std::min<std::size_t>(rows.size(), limits::kMaxHeldSegments) : 0;
  const auto end = rows.begin() + static_cast<std::ptrdiff_t>(count);
  rest_.assign(end, rows.end());
  rows.erase(end, rows.end());
  return rows;
}

std::vector<HeldMessage> HeldOffer::rest(const WelcomeMessage& welcome, std::vector<std::uint32_t>& untold) {
  const std::vector<HeldRow> rows = std::move(rest_);
  rest_.clear();
  const std::uint64_t messageBytes = welcome.limits.maxMessageBytes;
  const std::uint64_t rowsPerMessage = messageBytes > kAroundBytes ? (messageBytes - kAroundBytes) / kRowBytes : 0;
  const std::size_t most = static_cast<std::size_t>(
      std::min<std::uint64_t>({rowsPerMessage, welcome.limits.maxHeldSegments, limits::kMaxHeldSegments}));
  std::vector<HeldMessage> messages;
  if (most < 1) {
    for (const HeldRow& row : rows) untold.push_back(row.segment);
    return messages;
  }
  for (std::size_t at = 0; at < rows.size(); at += most) {
    HeldMessage message;
    const std::size_t end = std::min(rows.size(), at + most);
    message.segments.assign(rows.begin() + static_cast<std::ptrdiff_t>(at), rows.begin() + static_cast<std::ptrdiff_t>(end));
    messages.push_back(std::move(message));
  }
  return messages;
}

}  // namespace terraport
