#include "GlbContainer.h"

#include <string>

#include "LittleEndian.h"

namespace terraport {
namespace {

/// Bounds the parser's work on hostile bytes; our own documents have 2 to 4 KiB.
constexpr std::size_t kMaxJsonBytes = std::size_t{1} << 20;
constexpr std::size_t kGlbHeaderBytes = 12;
constexpr std::size_t kGlbChunkBytes = 8;
// As little-endian numbers.
constexpr std::uint32_t kGltf = 0x46546c67;
constexpr std::uint32_t kJsonChunk = 0x4e4f534a;
constexpr std::uint32_t kBinChunk = 0x004e4942;

Status chunkAt(ByteSpan payload, std::size_t at, std::uint32_t kind, const char* name, ByteSpan& out) {
  const std::size_t remaining = payload.size - at;
  if (remaining < kGlbChunkBytes) {
    return Status::damaged(
        std::to_string(remaining) + " bytes left, expected a " + name + " chunk", static_cast<std::int64_t>(at));
  }
  if (readU32(payload.data + at + 4) != kind) {
    return Status::damaged(std::string("another type of chunk, expected ") + name, static_cast<std::int64_t>(at + 4));
  }
  const std::uint32_t length = readU32(payload.data + at);
  if (length > remaining - kGlbChunkBytes) {
    return Status::damaged(
        "chunk of " + std::to_string(length) + " bytes, " + std::to_string(remaining - kGlbChunkBytes) + " left",
        static_cast<std::int64_t>(at));
  }
  out = {payload.data + at + kGlbChunkBytes, length};
  return {};
}

}  // namespace

Status splitGlb(ByteSpan payload, GlbChunks& chunks) {
  if (payload.size < kGlbHeaderBytes + kGlbChunkBytes) {
    return Status::damaged(std::to_string(payload.size) + " bytes, expected a GLB of at least 20", 0);
  }
  if (readU32(payload.data) != kGltf) {
    return Status::damaged("no magic glTF at the start", 0);
  }
  const std::uint32_t version = readU32(payload.data + 4);
  if (version != 2) {
    return Status::damaged("glTF version " + std::to_string(version) + ", expected 2", 4);
  }
  const std::uint32_t length = readU32(payload.data + 8);
  if (length != payload.size) {
    return Status::damaged(std::to_string(payload.size) + " bytes, expected " + std::to_string(length) + " by the header", 8);
  }
  ByteSpan text;
  TERRAPORT_RETURN_IF_ERROR(chunkAt(payload, kGlbHeaderBytes, kJsonChunk, "JSON", text));
  if (text.size > kMaxJsonBytes) {
    return Status::damaged("JSON chunk of " + std::to_string(text.size) + " bytes, expected at most 1 MiB", kGlbHeaderBytes);
  }
  chunks.jsonOffset = kGlbHeaderBytes + kGlbChunkBytes;
  chunks.json = {reinterpret_cast<const char*>(text.data), text.size};
  const std::size_t binaryAt = chunks.jsonOffset + text.size;
  TERRAPORT_RETURN_IF_ERROR(chunkAt(payload, binaryAt, kBinChunk, "BIN", chunks.binary));
  chunks.binaryOffset = binaryAt + kGlbChunkBytes;
  const std::size_t end = chunks.binaryOffset + chunks.binary.size;
  if (end != payload.size) {
    return Status::damaged(
        std::to_string(payload.size - end) + " bytes after the BIN chunk, expected none", static_cast<std::int64_t>(end));
  }
  return {};
}

}  // namespace terraport
