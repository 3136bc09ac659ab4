#include "SegmentFile.h"

#include <cstring>

#include "LittleEndian.h"
#include "Messages.generated.h"
#include "Terraport/Xxh3.h"

namespace terraport {
namespace {

const char kMagic[] = "TPSDKSG1";
constexpr std::size_t kHeadRowAt = 8;
constexpr std::size_t kHeadRowBytes = 48;
const std::string kEnding = std::string(".") + kPayloadEncoding;

template <typename Number>
void write(std::uint8_t* at, Number number) {
  for (std::size_t byte = 0; byte < sizeof(Number); ++byte) {
    at[byte] = static_cast<std::uint8_t>(number >> (8 * byte));
  }
}

}  // namespace

std::vector<std::uint8_t> segmentHead(const SegmentFacts& facts) {
  std::vector<std::uint8_t> head(kSegmentHeadBytes);
  std::memcpy(head.data(), kMagic, kHeadRowAt);
  write(&head[8], facts.segment);
  write(&head[12], facts.length);
  write(&head[16], facts.xxh3);
  write(&head[24], facts.faces);
  write(&head[28], facts.vertices);
  const Box& box = facts.bounds;
  const float bounds[6] = {box.minX, box.minY, box.minZ, box.maxX, box.maxY, box.maxZ};
  for (std::size_t at = 0; at < 6; ++at) {
    std::uint32_t bits = 0;
    std::memcpy(&bits, &bounds[at], sizeof(bits));
    write(&head[32 + 4 * at], bits);
  }
  write(&head[kHeadRowAt + kHeadRowBytes], xxh3Hash64({&head[kHeadRowAt], kHeadRowBytes}));
  return head;
}

std::optional<SegmentFacts> readSegmentHead(const std::uint8_t* head, std::uint64_t fileBytes) {
  if (std::memcmp(head, kMagic, kHeadRowAt) != 0 ||
      xxh3Hash64({head + kHeadRowAt, kHeadRowBytes}) != readU64(head + kHeadRowAt + kHeadRowBytes)) {
    return std::nullopt;
  }
  SegmentFacts facts;
  facts.segment = readU32(head + 8);
  facts.length = readU32(head + 12);
  facts.xxh3 = readU64(head + 16);
  facts.faces = readU32(head + 24);
  facts.vertices = readU32(head + 28);
  float* const bounds[6] = {
      &facts.bounds.minX, &facts.bounds.minY, &facts.bounds.minZ, &facts.bounds.maxX, &facts.bounds.maxY, &facts.bounds.maxZ};
  for (std::size_t at = 0; at < 6; ++at) {
    const std::uint32_t bits = readU32(head + 32 + 4 * at);
    std::memcpy(bounds[at], &bits, sizeof(bits));
  }
  if (facts.length == 0 || facts.length > limits::kMaxSegmentBytes || kSegmentHeadBytes + facts.length != fileBytes) {
    return std::nullopt;
  }
  return facts;
}

std::string hexOf(std::uint64_t number) {
  std::string text(16, '0');
  for (std::size_t digit = 16; digit-- > 0; number >>= 4) {
    text[digit] = "0123456789abcdef"[number & 15];
  }
  return text;
}

std::string segmentFileName(std::uint32_t segment, std::uint64_t xxh3) {
  return std::to_string(segment) + "-" + hexOf(xxh3) + kEnding;
}

std::optional<std::uint32_t> segmentOfFileName(const std::string& name) {
  const std::size_t dash = name.find('-');
  if (dash == std::string::npos || dash == 0 || dash > 10 || name.size() != dash + 17 + kEnding.size() ||
      name.compare(name.size() - kEnding.size(), kEnding.size(), kEnding) != 0) {
    return std::nullopt;
  }
  std::uint64_t segment = 0;
  for (std::size_t at = 0; at < dash; ++at) {
    if (name[at] < '0' || name[at] > '9') {
      return std::nullopt;
    }
    segment = 10 * segment + static_cast<std::uint64_t>(name[at] - '0');
  }
  return segment <= 0xffffffffu ? std::optional<std::uint32_t>(static_cast<std::uint32_t>(segment)) : std::nullopt;
}

}  // namespace terraport
