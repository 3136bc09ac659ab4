#include "Frames.h"

#include "Bytes.h"
#include "Messages.generated.h"

namespace terraport {

namespace {

constexpr std::uint8_t kSegmentChunk = 0x01;
constexpr std::uint8_t kFlagLast = 0x01;
constexpr std::uint8_t kFirstMessageByte = 0x80;

bool refused(const char* code, std::string text, DecodeError& error) {
  error = DecodeError{};
  error.code = code;
  error.message = std::move(text);
  return false;
}

}  // namespace

bool isPayload(ByteSpan data) {
  return data.size > 0 && data.data[0] < kFirstMessageByte;
}

bool decodeFrame(ByteSpan data, PayloadFrame& into, DecodeError& error) {
  // 1. A frame at all, and of a kind that is read here.
  if (data.size > limits::kMaxFrameBytes) {
    return refused("too_large",
        "got a frame of " + std::to_string(data.size) + " bytes, expected at most " + std::to_string(limits::kMaxFrameBytes),
        error);
  }
  if (data.size == 0) return refused("malformed", "got an empty message, expected a frame", error);
  const std::uint8_t kind = data.data[0];
  if (kind == 0 || kind >= kFirstMessageByte) {
    return refused("malformed", "got frame kind " + std::to_string(kind) + ", expected 1 to 127", error);
  }
  into = PayloadFrame{};
  if (kind != kSegmentChunk) {
    into.unknownKind = kind;
    return true;
  }
  // 2. The header. A later minor version may append to it: its own length says where the chunk starts.
  if (data.size < limits::kHeaderBytes) {
    return refused("malformed", "got " + std::to_string(data.size) + " bytes, expected a header of 24", error);
  }
  const std::uint32_t header = readU16Le(data.data + 2);
  if (header < limits::kHeaderBytes || header > limits::kMaxHeaderBytes) {
    return refused("malformed", "got a header of " + std::to_string(header) + ", expected 24 to 1024", error);
  }
  into.generation = readU32Le(data.data + 4);
  into.segment = readU32Le(data.data + 8);
  into.offset = readU32Le(data.data + 12);
  into.total = readU32Le(data.data + 16);
  if (into.total > limits::kMaxSegmentBytes) {
    return refused("too_large",
        "got a segment of " + std::to_string(into.total) + " bytes, expected at most " +
            std::to_string(limits::kMaxSegmentBytes),
        error);
  }
  // 3. The chunk: it lies within the payload, and is marked as the last exactly where it ends it.
  if (data.size <= header) return refused("malformed", "got no payload bytes, expected at least one", error);
  into.chunk = {data.data + header, data.size - header};
  const std::uint64_t end = std::uint64_t{into.offset} + into.chunk.size;
  if (end > into.total) {
    return refused("malformed",
        "got " + std::to_string(into.chunk.size) + " bytes at " + std::to_string(into.offset) + ", expected to end within " +
            std::to_string(into.total),
        error);
  }
  into.isLast = (data.data[1] & kFlagLast) != 0;
  if (into.isLast != (end == into.total)) {
    return refused("malformed", "got a last chunk that does not end the segment, or the other way round", error);
  }
  return true;
}

Status encodeFrame(const PayloadFrame& frame, std::string& into) {
  const std::uint64_t end = std::uint64_t{frame.offset} + frame.chunk.size;
  if (frame.chunk.size < 1 || frame.chunk.size > limits::kMaxChunkBytes || end > frame.total ||
      frame.total > limits::kMaxSegmentBytes) {
    return Status::failed("invalid_field",
        "frame: got " + std::to_string(frame.chunk.size) + " bytes at " + std::to_string(frame.offset) + " of " +
            std::to_string(frame.total));
  }
  into.clear();
  into.push_back(static_cast<char>(kSegmentChunk));
  into.push_back(static_cast<char>(end == frame.total ? kFlagLast : 0));
  appendLe(limits::kHeaderBytes, 2, into);
  for (const std::uint32_t field : {frame.generation, frame.segment, frame.offset, frame.total, 0u}) {
    appendLe(field, 4, into);
  }
  into.append(reinterpret_cast<const char*>(frame.chunk.data), frame.chunk.size);
  return Status::ok();
}

}  // namespace terraport
