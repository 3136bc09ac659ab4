// What a service sends on one connection: messages and frames, each behind its length in two bytes.
#include <algorithm>

#include "Core/Session.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace terraport;
  Session session({"fuzz", {}, 1 << 20, 1 << 20}, {});
  session.connected();
  (void)session.land({{30, 1, 30}, 10, std::nullopt, 5.0});
  for (std::size_t at = 0; at + 2 <= size;) {
    const std::size_t length = std::min<std::size_t>(readU16(data + at), size - at - 2);
    const Bytes message(data + at + 2, data + at + 2 + length);
    at += 2 + length;
    if (!session.receive(message).isOk()) break;
    for (const Event& event : session.takeEvents()) {
      if (const auto* came = std::get_if<SegmentCame>(&event)) session.decoded(came->key, {}, came->payload);
    }
    (void)session.takeMessages();
  }
  return 0;
}
