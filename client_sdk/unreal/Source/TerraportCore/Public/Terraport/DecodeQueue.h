// Where payloads are decoded.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "Terraport/Api.h"
#include "Terraport/SceneFiles.h"
#include "Terraport/SegmentMesh.h"
#include "Terraport/Status.h"
#include "Terraport/Types.h"

namespace terraport {

/// A payload to be decoded.
struct DecodeJob {
  std::uint32_t segment = 0;
  /// Given back with the answer: answers to requests of an earlier scene version are dropped.
  std::uint32_t epoch = 0;
  SharedPayload payload;
  /// Of the scene version that the payload is of: the scales of its attributes.
  SharedSceneFiles files;
};

/// A decoded payload, or why there is none.
struct DecodedSegment {
  std::uint32_t segment = 0;
  std::uint32_t epoch = 0;
  Status status;
  /// Empty, or null, where the status is a failure. Give it to DecodeQueue::release, so that its memory is used again.
  std::unique_ptr<SegmentMesh> mesh;
  /// Where `mesh->image` lies.
  SharedPayload payload;
};

/// Decode one job into `mesh`, in the calling thread: what every queue does. The decoder's own memory belongs to the thread,
/// and is used again. A job without `files` is of a scene without attributes.
TERRAPORTCORE_API Status decodePayload(const DecodeJob& job, SegmentMesh& mesh);

/// Decodes elsewhere, or later. Called from one thread, the stage's; nothing blocks.
class TERRAPORTCORE_API DecodeQueue {
 public:
  virtual ~DecodeQueue() = default;

  /// Take a job. The stage bounds how many are under way (StageOptions::maxInFlight).
  virtual void push(DecodeJob job) = 0;

  /// The next answer, in whatever order; false where there is none now.
  virtual bool tryPop(DecodedSegment& out) = 0;

  /// Take memory back that `tryPop` handed out.
  virtual void release(std::unique_ptr<SegmentMesh> mesh) = 0;

  /// Decode one job in the calling thread, where the queue has no thread of its own; false where there was nothing to do. The
  /// stage calls it while its frame has time.
  virtual bool step() { return false; }
};

}  // namespace terraport
