// Payload frames: one chunk of one segment in one binary WebSocket message (wire protocol, section 4).
#pragma once

#include "Terraport/Status.h"
#include "Terraport/Types.h"
#include "WireErrors.h"

#include <cstdint>
#include <optional>
#include <string>

namespace terraport {

/// One chunk of a segment's payload.
struct PayloadFrame {
  /// Generation of the plan or prefetch that it is sent for.
  std::uint32_t generation = 0;
  std::uint32_t segment = 0;
  /// Place of the chunk in the payload, bytes.
  std::uint32_t offset = 0;
  /// Length of the whole payload, bytes.
  std::uint32_t total = 0;
  /// The chunk ends the segment.
  bool isLast = false;
  /// A view of the received message.
  ByteSpan chunk;
  /// A frame of a kind that this version does not know: skip it. The rest has no meaning then.
  std::optional<std::uint8_t> unknownKind;
};

/// Whether a binary WebSocket message is a payload frame and not a message: a msgpack map starts at 0x80.
bool isPayload(ByteSpan data);

/// Read the frame that one binary WebSocket message holds; false where it is cut off, too long, contradicts itself, or is no
/// frame.
bool decodeFrame(ByteSpan data, PayloadFrame& into, DecodeError& error);

/// Write a frame; `isLast` is told by offset and total. A server's part; here so that both directions are tested against one
/// corpus. Error code: `invalid_field`.
Status encodeFrame(const PayloadFrame& frame, std::string& into);

}  // namespace terraport
