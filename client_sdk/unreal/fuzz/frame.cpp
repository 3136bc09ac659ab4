// Payload frames. What is read is written again, and reads as the same.
#include "Frames.h"
#include "Messages.generated.h"

#include <cstdint>
#include <cstdlib>
#include <cstring>

using namespace terraport;

namespace {

void expect(bool isTrue) {
  if (!isTrue) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  PayloadFrame frame;
  DecodeError error;
  if (!decodeFrame({data, size}, frame, error)) {
    expect(!error.code.empty());
    return 0;
  }
  if (frame.unknownKind) return 0;
  expect(frame.chunk.data >= data && frame.chunk.data + frame.chunk.size == data + size);
  expect(std::uint64_t{frame.offset} + frame.chunk.size <= frame.total && frame.total <= limits::kMaxSegmentBytes);
  std::string written;
  expect(encodeFrame(frame, written).isOk());
  PayloadFrame again;
  expect(decodeFrame({reinterpret_cast<const std::uint8_t*>(written.data()), written.size()}, again, error));
  expect(again.generation == frame.generation && again.segment == frame.segment && again.offset == frame.offset);
  expect(again.total == frame.total && again.isLast == frame.isLast && again.chunk.size == frame.chunk.size);
  expect(std::memcmp(again.chunk.data, frame.chunk.data, frame.chunk.size) == 0);
  return 0;
}
