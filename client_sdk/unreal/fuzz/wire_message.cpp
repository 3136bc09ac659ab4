// Messages of both directions. The first byte chooses; the rest is one WebSocket message.
//
// What is read must be writable, and what was written must read as the same.
#include "WireCodec.h"

#include <cstdint>
#include <cstdlib>

using namespace terraport;

namespace {

void expect(bool isTrue) {
  if (!isTrue) std::abort();
}

template <typename Message>
void tryMessage(ByteSpan data) {
  static MessageReader reader;
  Message message;
  DecodeError error;
  if (!reader.read(data, message, error)) {
    expect(!error.code.empty() && !error.message.empty());
    return;
  }
  if (std::holds_alternative<UnknownMessage>(message)) return;
  EncodedMessage first;
  expect(encodeMessage(message, first).isOk());
  Message again;
  EncodedMessage written;
  expect(reader.read(first.view(), again, error));
  expect(encodeMessage(again, written).isOk() && written.bytes == first.bytes);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const ByteSpan message{data + 1, size - 1};
  if ((data[0] & 1) != 0) {
    tryMessage<ClientMessage>(message);
  } else {
    tryMessage<ServerMessage>(message);
  }
  return 0;
}
