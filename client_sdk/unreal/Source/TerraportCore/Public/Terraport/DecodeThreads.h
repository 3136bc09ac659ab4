// The two queues that the core brings along: on threads of its own, and in the frame.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>

#include "Terraport/Api.h"
#include "Terraport/DecodeQueue.h"

namespace terraport {

/// Called on the decoding thread with each mesh that was decoded, where an engine turns axes or packs vertices (into
/// SegmentMesh::engineData). It must not touch the queue. `payload` is where the mesh's image lies.
using AfterDecode = std::function<void(SegmentMesh& mesh, const SharedPayload& payload)>;

/// Decodes on threads of its own. Destroying it drops what waits and joins the threads: some milliseconds.
class TERRAPORTCORE_API DecodeThreads final : public DecodeQueue {
 public:
  /// `threads` is at least 1. At most `maxSpare` meshes that nobody uses are kept for their memory.
  explicit DecodeThreads(std::size_t threads = 2, AfterDecode afterDecode = nullptr, std::size_t maxSpare = 16);
  ~DecodeThreads() override;
  DecodeThreads(const DecodeThreads&) = delete;
  DecodeThreads& operator=(const DecodeThreads&) = delete;

  void push(DecodeJob job) override;
  bool tryPop(DecodedSegment& out) override;
  void release(std::unique_ptr<SegmentMesh> mesh) override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Decodes in the calling thread, one job for each `step`: for platforms without threads, and for tests.
class TERRAPORTCORE_API InlineDecodes final : public DecodeQueue {
 public:
  explicit InlineDecodes(AfterDecode afterDecode = nullptr, std::size_t maxSpare = 16);
  ~InlineDecodes() override;
  InlineDecodes(const InlineDecodes&) = delete;
  InlineDecodes& operator=(const InlineDecodes&) = delete;

  void push(DecodeJob job) override;
  bool tryPop(DecodedSegment& out) override;
  void release(std::unique_ptr<SegmentMesh> mesh) override;
  bool step() override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace terraport
