#include "Terraport/DecodeThreads.h"

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <new>
#include <thread>
#include <utility>
#include <vector>

#include "SegmentFormat.h"

namespace terraport {
namespace {

/// Meshes that nobody uses, for their memory. Not thread-safe.
class SpareMeshes {
 public:
  explicit SpareMeshes(std::size_t most) : most_(most) {}

  std::unique_ptr<SegmentMesh> take() {
    if (meshes_.empty()) {
      return std::unique_ptr<SegmentMesh>(new (std::nothrow) SegmentMesh);
    }
    std::unique_ptr<SegmentMesh> mesh = std::move(meshes_.back());
    meshes_.pop_back();
    return mesh;
  }

  void give(std::unique_ptr<SegmentMesh> mesh) {
    if (mesh && meshes_.size() < most_) {
      meshes_.push_back(std::move(mesh));
    }
  }

 private:
  std::size_t most_;
  std::vector<std::unique_ptr<SegmentMesh>> meshes_;
};

DecodedSegment answerOf(DecodeJob job, std::unique_ptr<SegmentMesh> mesh, const AfterDecode& afterDecode) {
  DecodedSegment answer;
  answer.segment = job.segment;
  answer.epoch = job.epoch;
  answer.status = mesh ? decodePayload(job, *mesh) : Status::failed("out_of_memory", "no memory for a mesh");
  if (answer.status.isOk() && afterDecode) {
    afterDecode(*mesh, job.payload);
  }
  // A mesh that failed is given back all the same: its memory is as good as any.
  answer.mesh = std::move(mesh);
  answer.payload = std::move(job.payload);
  return answer;
}

}  // namespace

Status decodePayload(const DecodeJob& job, SegmentMesh& mesh) {
  // The decoder's own memory is used again by every payload of this thread.
  static thread_local SegmentDecoder decoder;
  static const std::vector<AttributeInfo> noAttributes;
  if (!job.payload) {
    mesh.clear();
    return Status::failed("invalid_argument", "no payload to decode");
  }
  const std::vector<AttributeInfo>& attributes = job.files ? job.files->manifest.attributes : noAttributes;
  return decoder.decode(viewOf(*job.payload), attributes, job.segment, mesh);
}

struct DecodeThreads::Impl {
  Impl(AfterDecode after, std::size_t maxSpare) : afterDecode(std::move(after)), spare(maxSpare) {}

  void work() {
    std::unique_lock<std::mutex> lock(mutex);
    for (;;) {
      wake.wait(lock, [this] { return isEnding || !jobs.empty(); });
      if (isEnding) {
        return;
      }
      DecodeJob job = std::move(jobs.front());
      jobs.pop_front();
      std::unique_ptr<SegmentMesh> mesh = spare.take();
      // Decoding takes milliseconds, in which the stage asks and takes.
      lock.unlock();
      DecodedSegment answer = answerOf(std::move(job), std::move(mesh), afterDecode);
      lock.lock();
      answers.push_back(std::move(answer));
    }
  }

  const AfterDecode afterDecode;
  std::mutex mutex;
  std::condition_variable wake;
  std::deque<DecodeJob> jobs;
  std::deque<DecodedSegment> answers;
  SpareMeshes spare;
  bool isEnding = false;
  std::vector<std::thread> threads;
};

DecodeThreads::DecodeThreads(std::size_t threads, AfterDecode afterDecode, std::size_t maxSpare)
    : impl_(new Impl(std::move(afterDecode), maxSpare)) {
  for (std::size_t thread = 0; thread < std::max<std::size_t>(threads, 1); ++thread) {
    impl_->threads.emplace_back([impl = impl_.get()] { impl->work(); });
  }
}

DecodeThreads::~DecodeThreads() {
  {
    const std::lock_guard<std::mutex> lock(impl_->mutex);
    impl_->isEnding = true;
  }
  impl_->wake.notify_all();
  for (std::thread& thread : impl_->threads) {
    thread.join();
  }
}

void DecodeThreads::push(DecodeJob job) {
  {
    const std::lock_guard<std::mutex> lock(impl_->mutex);
    impl_->jobs.push_back(std::move(job));
  }
  impl_->wake.notify_one();
}

bool DecodeThreads::tryPop(DecodedSegment& out) {
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  if (impl_->answers.empty()) {
    return false;
  }
  out = std::move(impl_->answers.front());
  impl_->answers.pop_front();
  return true;
}

void DecodeThreads::release(std::unique_ptr<SegmentMesh> mesh) {
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  impl_->spare.give(std::move(mesh));
}

struct InlineDecodes::Impl {
  Impl(AfterDecode after, std::size_t maxSpare) : afterDecode(std::move(after)), spare(maxSpare) {}

  const AfterDecode afterDecode;
  std::deque<DecodeJob> jobs;
  std::deque<DecodedSegment> answers;
  SpareMeshes spare;
};

InlineDecodes::InlineDecodes(AfterDecode afterDecode, std::size_t maxSpare)
    : impl_(new Impl(std::move(afterDecode), maxSpare)) {}

InlineDecodes::~InlineDecodes() = default;

void InlineDecodes::push(DecodeJob job) {
  impl_->jobs.push_back(std::move(job));
}

bool InlineDecodes::tryPop(DecodedSegment& out) {
  if (impl_->answers.empty()) {
    return false;
  }
  out = std::move(impl_->answers.front());
  impl_->answers.pop_front();
  return true;
}

void InlineDecodes::release(std::unique_ptr<SegmentMesh> mesh) {
  impl_->spare.give(std::move(mesh));
}

bool InlineDecodes::step() {
  if (impl_->jobs.empty()) {
    return false;
  }
  DecodeJob job = std::move(impl_->jobs.front());
  impl_->jobs.pop_front();
  impl_->answers.push_back(answerOf(std::move(job), impl_->spare.take(), impl_->afterDecode));
  return true;
}

}  // namespace terraport
