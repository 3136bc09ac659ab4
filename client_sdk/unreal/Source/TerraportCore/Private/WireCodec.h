// Messages to bytes, and back (wire protocol, section 3).
#pragma once

#include "Messages.generated.h"
#include "Terraport/Json.h"
#include "Terraport/Status.h"
#include "Terraport/Types.h"
#include "WireErrors.h"

#include <cstddef>
#include <string>

namespace terraport {

/// One WebSocket message on its way out.
struct EncodedMessage {
  std::string bytes;

  ByteSpan view() const { return {reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()}; }
};

/// Type of a message on the wire.
const char* typeOf(const ClientMessage& message);
const char* typeOf(const ServerMessage& message);

// Write a message. Keys stand in the order of the fields, `type` first; absent fields are left out; the same message gives
// the same bytes every time. Error code: `invalid_field`, where a field is not what the protocol allows; `into` is then
// unchanged. An UnknownMessage cannot be written.
Status encodeMessage(const ClientMessage& message, EncodedMessage& into);
Status encodeMessage(const ServerMessage& message, EncodedMessage& into);

/// Whether a message's fields are what the protocol allows. Error code: `invalid_field`.
Status checkMessage(const ClientMessage& message);

/// Reads messages; keeps its memory from one to the next. Not safe on two threads at a time.
class MessageReader {
 public:
  // Read the message that a binary WebSocket message holds; unknown keys are skipped. `maxBytes` is a stricter limit than the
  // protocol's own for this direction. False where it is no message, too long, or has a field that is missing, mistyped or
  // out of range: `error` then says why, and `into` is anything.
  bool read(ByteSpan data, ClientMessage& into, DecodeError& error, std::size_t maxBytes = static_cast<std::size_t>(-1));
  bool read(ByteSpan data, ServerMessage& into, DecodeError& error, std::size_t maxBytes = static_cast<std::size_t>(-1));

 private:
  template <typename Message>
  bool readAny(ByteSpan data, std::size_t maxBytes, Message& into, DecodeError& error);

  JsonDocument document_;
};

}  // namespace terraport
