// Messages of both subprotocols and both directions. The first byte chooses; the rest is one WebSocket message.
//
// What is read must be writable, and what was written must read as the same in the other subprotocol too.
#include "WireCodec.h"

#include <cstdint>
#include <cstdlib>

using namespace terraport;

namespace {

void expect(bool isTrue) {
  if (!isTrue) std::abort();
}

template <typename Message>
void tryMessage(ByteSpan data, Subprotocol subprotocol) {
  static MessageReader reader;
  Message message;
  DecodeError error;
  if (!reader.read(data, subprotocol == Subprotocol::Json, subprotocol, message, error)) {
    expect(!error.code.empty() && !error.message.empty());
    return;
  }
  if (std::holds_alternative<UnknownMessage>(message)) return;
  EncodedMessage json;
  EncodedMessage packed;
  expect(encodeMessage(message, Subprotocol::Json, json).isOk());
  expect(encodeMessage(message, Subprotocol::Msgpack, packed).isOk());
  Message again;
  EncodedMessage written;
  expect(reader.read(json.view(), true, Subprotocol::Json, again, error));
  expect(encodeMessage(again, Subprotocol::Msgpack, written).isOk() && written.bytes == packed.bytes);
  expect(reader.read(packed.view(), false, Subprotocol::Msgpack, again, error));
  expect(encodeMessage(again, Subprotocol::Json, written).isOk() && written.bytes == json.bytes);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const Subprotocol subprotocol = (data[0] & 1) != 0 ? Subprotocol::Json : Subprotocol::Msgpack;
  const ByteSpan message{data + 1, size - 1};
  if ((data[0] & 2) != 0) {
    tryMessage<ClientMessage>(message, subprotocol);
  } else {
    tryMessage<ServerMessage>(message, subprotocol);
  }
  return 0;
}
