// Chunks to payloads. Pure.
#pragma once

#include "Frames.h"
#include "Terraport/Status.h"
#include "Terraport/Types.h"

#include <cstdint>
#include <map>
#include <vector>

namespace terraport {

/// Partial payloads of segments that are on their way.
///
/// A segment comes in chunks, in order, without gap or overlap (wire protocol, section 4). A newer landing may carry on where
/// an older one stopped; what it does not need is forgotten by both sides (6.5, rule 3). Memory grows with what has come,
/// never with what was announced.
class Assembler {
 public:
  /// Segments that are partly here.
  std::size_t size() const { return partials_.size(); }

  /// Take one chunk; `payload` is set when this was its last one. `length`: the payload's length by the load table.
  /// Error code: `malformed`, on a gap, an overlap, or a total that is not the plan's.
  Status take(const PayloadFrame& frame, std::uint32_t length, SharedPayload& payload);

  /// Forget the partial payloads of all segments but these.
  void keepOnly(const std::map<std::uint32_t, SegmentFacts>& segments);

  /// Forget everything: the connection is gone.
  void clear() { partials_.clear(); }

 private:
  /// Bytes received so far, by segment.
  std::map<std::uint32_t, std::vector<std::uint8_t>> partials_;
};

}  // namespace terraport
