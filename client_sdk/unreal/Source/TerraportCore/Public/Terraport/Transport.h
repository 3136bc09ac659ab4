#pragma once

#include "Terraport/Api.h"
#include "Terraport/Status.h"
#include "Terraport/Types.h"

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace terraport {

/// Where a WebSocket stands.
enum class TransportState : std::uint8_t { Connecting, Open, Closed };

/// One whole WebSocket message. Reuse one object: its buffer keeps its memory.
struct TransportMessage {
  /// A text message, which the session refuses: the protocol has none.
  bool isText = false;
  std::vector<std::uint8_t> bytes;
};

/// One WebSocket connection, polled: nothing here blocks, and nothing calls back.
///
/// All methods are called from the thread that pumps the stream, one at a time. An implementation whose library delivers on
/// other threads keeps a bounded queue between them; where the queue is full it stops reading the socket, or closes with
/// 1006: it must not drop messages. It must not negotiate permessage-deflate, and answers pings by itself.
class TERRAPORTCORE_API Transport {
 public:
  virtual ~Transport() = default;

  /// Begin to connect to `ws(s)://...`, once. `subprotocols` are offered in this order. `bearerToken`, where it is not empty,
  /// goes into the header `Authorization: Bearer`; where a platform cannot set headers, into the subprotocol entry
  /// `tokenSubprotocol(bearerToken)`. It must not be logged. Failures show in `state` and `closeCode`.
  virtual void open(const std::string& url, const std::vector<std::string>& subprotocols, const std::string& bearerToken) = 0;

  virtual TransportState state() const = 0;

  /// The subprotocol that the server chose; empty before `Open`, or where it chose none.
  virtual std::string subprotocol() const = 0;

  /// Take the next whole message, at most `maxMessageBytes` long (see `MessageAssembler`); false where none is here.
  /// What came before a close can still be taken after it.
  virtual bool tryReceive(TransportMessage& message) = 0;

  /// Hand over one whole binary message; false where the connection is not open or its buffer is full for now.
  virtual bool trySend(ByteSpan bytes) = 0;

  /// Close code of the server, or 1006 where the connection broke or never came about; 0 before `Closed`.
  virtual int closeCode() const = 0;

  /// Reason that came with the close code, or what the platform said of a broken connection; for people.
  virtual std::string closeReason() const = 0;

  /// Close, politely where that is possible without waiting. The object may be destroyed right after.
  virtual void close(int code, const std::string& reason) = 0;
};

/// Makes one transport for each connection of a stream.
class TERRAPORTCORE_API TransportFactory {
 public:
  virtual ~TransportFactory() = default;

  /// A transport on which `open` was not called yet; never null.
  virtual std::unique_ptr<Transport> make() = 0;
};

/// The subprotocol entry that carries a token where no header can be set (wire protocol, section 2.3).
TERRAPORTCORE_API std::string tokenSubprotocol(const std::string& token);

}  // namespace terraport
