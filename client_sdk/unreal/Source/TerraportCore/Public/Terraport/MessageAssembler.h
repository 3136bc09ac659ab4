#pragma once

#include "Terraport/Api.h"
#include "Terraport/Status.h"
#include "Terraport/Transport.h"
#include "Terraport/Types.h"

#include <cstddef>
#include <cstdint>
#include <deque>
#include <vector>

namespace terraport {

/// Pieces of WebSocket messages to whole messages: libraries hand over what came in one read (Unreal's
/// `IWebSocket::OnBinaryMessage`, libwebsockets), and a bounded queue of what is whole. Not safe on two threads at a time.
class TERRAPORTCORE_API MessageAssembler {
 public:
  struct Limits {
    /// A longer message is refused: the wire protocol's bound on what a server sends.
    std::size_t maxMessageBytes = 8u * 1024 * 1024;
    /// Bytes that wait in whole messages; at least one message may wait. With credit they are bounded by it, too.
    std::size_t maxWaitingBytes = 64u * 1024 * 1024;
  };

  MessageAssembler() : MessageAssembler(Limits{}) {}
  explicit MessageAssembler(const Limits& limits) : limits_(limits) {}

  /// Take a piece. `isLast`: it ends the message. Error codes: `too_large` (the message, or what waits), `malformed` (a
  /// text piece goes on in binary). After an error the connection must be closed.
  Status take(ByteSpan fragment, bool isText, bool isLast);

  /// As `take`, where the library says only how many bytes of the message are still to come. Unreal's
  /// `OnRawMessage(data, size, bytesRemaining)` counts what remains of the present WebSocket frame.
  Status takeRemaining(ByteSpan fragment, bool isText, std::size_t bytesRemaining) {
    return take(fragment, isText, bytesRemaining == 0);
  }

  /// The oldest whole message, swapped into `message`; false where there is none.
  bool tryNext(TransportMessage& message);

  /// Whether a further message may be taken in; an implementation that can stop reading its socket does so where not.
  bool hasRoom() const { return waitingBytes_ < limits_.maxWaitingBytes; }

  /// Bytes of whole messages that were not taken out.
  std::size_t waitingBytes() const { return waitingBytes_; }

  /// Forget everything: the connection is gone.
  void clear();

 private:
  Limits limits_;
  TransportMessage assembling_;
  bool inMessage_ = false;
  std::deque<TransportMessage> whole_;
  std::size_t waitingBytes_ = 0;
  /// Buffers to be used again.
  std::vector<std::vector<std::uint8_t>> spare_;
};

}  // namespace terraport
