// A stage with everything around it: a stream whose events the test makes, a renderer that notes what would be drawn, a clock
// that runs with the work.
#pragma once

#include <doctest/doctest.h>

#include <algorithm>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "Terraport/DecodeThreads.h"
#include "Terraport/SceneStage.h"
#include "test_files.h"

namespace terraport_tests {

using SegmentSet = std::set<std::uint32_t>;

/// Milliseconds that work takes; nothing else makes it go on.
struct WorkClock {
  double nowMs = 0.0;
  void spend(double ms) { nowMs += ms; }
};

/// Holds payloads of a corpus file for whatever segments it is told to.
class FakeStream final : public terraport::LandingStream {
 public:
  FakeStream() {
    const auto path = conformance() / "scene" / "payload" / "good-colours.tsg";
    validPayload = std::make_shared<const std::vector<std::uint8_t>>(readFile(path));
    std::vector<std::uint8_t> broken = *validPayload;
    broken[broken.size() / 2] ^= 0xff;
    broken[8] ^= 1;
    damagedPayload = std::make_shared<const std::vector<std::uint8_t>>(broken);
  }

  std::int64_t land(const terraport::Vec3&, double, const terraport::LandOptions& options) override {
    landedRingM = options.coarseRadiusM;
    return ++landing;
  }
  void aim(const terraport::Vec3&, double, const std::optional<double>& coarseRadiusM) override { aimedRingM = coarseRadiusM; }
  terraport::SharedPayload payload(std::uint32_t segment) const override {
    if (held.count(segment) == 0) {
      return nullptr;
    }
    return damaged.count(segment) != 0 ? damagedPayload : validPayload;
  }

  terraport::SharedPayload validPayload;
  terraport::SharedPayload damagedPayload;
  SegmentSet held;
  SegmentSet damaged;
  std::int64_t landing = 0;
  std::optional<double> landedRingM;
  std::optional<double> aimedRingM;
};

/// Draws nothing. An order that a real renderer could not keep fails the test.
class NotingRenderer final : public terraport::SceneRenderer {
 public:
  explicit NotingRenderer(WorkClock& clock) : clock_(clock) {}

  terraport::UploadState upload(std::uint32_t segment, const terraport::SegmentMesh& mesh, terraport::ByteSpan) override {
    CHECK(mesh.vertexCount > 0);
    CHECK(uploaded.count(segment) == 0);
    clock_.spend(uploadMs);
    ++uploads;
    if (slices > 1 && ++slicesBySegment[segment] < slices) {
      return terraport::UploadState::More;
    }
    slicesBySegment.erase(segment);
    if (refused.count(segment) != 0) {
      return terraport::UploadState::Failed;
    }
    uploaded.insert(segment);
    return terraport::UploadState::Done;
  }

  bool isDrawable(std::uint32_t segment) override {
    CHECK(uploaded.count(segment) == 1);
    drawable.insert(segment);
    return true;
  }

  void free(std::uint32_t segment) override {
    CHECK(shown.count(segment) == 0);
    CHECK(uploaded.count(segment) + slicesBySegment.count(segment) + refused.count(segment) > 0);
    uploaded.erase(segment);
    drawable.erase(segment);
    slicesBySegment.erase(segment);
    ++frees;
  }

  std::size_t gpuBytesOf(const terraport::SegmentMesh&) const override { return 1000; }

  void beginBase(const terraport::SceneFiles& files) override {
    uploaded.clear();
    drawable.clear();
    slicesBySegment.clear();
    shown.clear();
    drawn.assign(files.base.faceCount, 0);
    prepared.clear();
    ++bases;
  }

  void prepareBase(const terraport::FaceRange& block, const terraport::HiddenFaces& next) override {
    REQUIRE(next.faceCount == drawn.size());
    REQUIRE(block.first + block.count <= next.faceCount);
    clock_.spend(blockMs);
    prepared[block.first].assign(next.faces + block.first, next.faces + block.first + block.count);
  }

  bool isBaseReady() override { return isReady; }

  void swap(const terraport::SceneSwap& change) override {
    ++swaps;
    for (const std::uint32_t segment : change.hidden) {
      CHECK(shown.erase(segment) == 1);
    }
    for (const std::uint32_t segment : change.shown) {
      CHECK(drawable.count(segment) == 1);
      CHECK(shown.insert(segment).second);
    }
    for (const terraport::FaceRange& block : change.baseBlocks) {
      const auto faces = prepared.find(block.first);
      REQUIRE(faces != prepared.end());
      REQUIRE(faces->second.size() == block.count);
      std::copy(faces->second.begin(), faces->second.end(), drawn.begin() + block.first);
    }
    CHECK(std::equal(drawn.begin(), drawn.end(), change.baseHidden.faces));
  }

  double uploadMs = 0.0;
  double blockMs = 0.0;
  int slices = 1;
  bool isReady = true;
  int uploads = 0;
  int frees = 0;
  int swaps = 0;
  int bases = 0;
  SegmentSet uploaded;
  SegmentSet drawable;
  SegmentSet shown;
  SegmentSet refused;
  std::map<std::uint32_t, int> slicesBySegment;
  /// One byte per face of what is drawn, as the prepared blocks had it.
  std::vector<std::uint8_t> drawn;
  std::map<std::uint32_t, std::vector<std::uint8_t>> prepared;

 private:
  WorkClock& clock_;
};

/// Files whose base has `faces` faces, each under a few of `segments` neighbouring segments, or none.
inline terraport::SharedSceneFiles randomFiles(
    std::uint64_t seed, std::uint32_t faces, std::uint32_t segments, std::uint32_t levels = 1) {
  Chance chance(seed);
  auto files = std::make_shared<terraport::SceneFiles>();
  files->manifest.baseFaces = faces;
  files->manifest.segmentCount = segments;
  files->manifest.levels = levels;
  files->base.faceCount = faces;
  files->cover.offsets.push_back(0);
  for (std::uint32_t face = 0; face < faces; ++face) {
    const std::uint32_t first = face * segments / faces;
    const std::uint32_t count = chance.below(4);
    for (std::uint32_t at = 0; at < count && first + at < segments; ++at) {
      files->cover.segments.push_back(first + at);
    }
    files->cover.offsets.push_back(static_cast<std::uint32_t>(files->cover.segments.size()));
  }
  return files;
}

/// The rule itself: hidden if and only if the list is not empty and every segment in it is shown.
inline std::vector<std::uint8_t> hiddenBy(const terraport::Cover& cover, const SegmentSet& shown) {
  std::vector<std::uint8_t> hidden(cover.faceCount(), 0);
  for (std::uint32_t face = 0; face < cover.faceCount(); ++face) {
    bool isHidden = cover.offsets[face] < cover.offsets[face + 1];
    for (std::uint32_t at = cover.offsets[face]; at < cover.offsets[face + 1]; ++at) {
      isHidden = isHidden && shown.count(cover.segments[at]) != 0;
    }
    hidden[face] = isHidden ? 1 : 0;
  }
  return hidden;
}

/// See the head of the file.
class Stand {
 public:
  explicit Stand(const terraport::StageOptions& options = {}, std::uint32_t faces = 900, std::uint32_t segments = 40,
      std::uint32_t levels = 1)
      : renderer(clock), files(randomFiles(7, faces, segments, levels)) {
    stage = std::make_unique<terraport::SceneStage>(stream, files, renderer, decodes, options);
  }

  ~Stand() { renderer.shown.clear(); }  // at the end alone a shown segment is freed

  std::int64_t land() { return stage->land({1.0, 2.0, 3.0}, 60.0, {}, clock.nowMs); }

  void planned(std::int64_t landing, const SegmentSet& load, const SegmentSet& keep = {}, const SegmentSet& nearby = {}) {
    terraport::StreamEvent event;
    event.kind = terraport::EventKind::Planned;
    event.landing = event.plan.landing = landing;
    for (const std::uint32_t segment : load) {
      event.plan.load.push_back(facts(segment));
    }
    event.plan.keep.assign(keep.begin(), keep.end());
    event.plan.nearby.assign(nearby.begin(), nearby.end());
    stage->handle(event);
  }

  void arrived(std::int64_t landing, std::uint32_t segment) {
    stream.held.insert(segment);
    terraport::StreamEvent event;
    event.kind = terraport::EventKind::Arrived;
    event.landing = landing;
    event.facts = facts(segment);
    stage->handle(event);
  }

  void ready(std::int64_t landing, const SegmentSet& visible, const SegmentSet& missing = {}) {
    tell(terraport::EventKind::Ready, landing, visible, missing);
  }
  void degraded(std::int64_t landing, const SegmentSet& segments) { tell(terraport::EventKind::Degraded, landing, segments); }
  void refused(std::int64_t landing) { tell(terraport::EventKind::Refused, landing, {}); }
  void dropped(const SegmentSet& segments) {
    for (const std::uint32_t segment : segments) {
      stream.held.erase(segment);
    }
    tell(terraport::EventKind::Dropped, terraport::kNoLanding, segments);
  }
  void versionChanged() {
    terraport::StreamEvent event;
    event.kind = terraport::EventKind::Opened;
    event.changed = true;
    stage->handle(event);
  }

  /// One frame, and what must hold after every frame.
  void update(double budgetMs = 1e9) {
    const int before = renderer.swaps;
    const SegmentSet shownBefore = renderer.shown;
    clock.nowMs += 1.0;
    stage->update([this] { return clock.nowMs; }, budgetMs);
    CHECK(renderer.swaps - before <= 1);
    if (renderer.swaps == before) {
      CHECK(renderer.shown == shownBefore);
    }
    compare();
  }

  /// A landing from asking to the last byte.
  std::int64_t whole(const SegmentSet& segments) {
    const std::int64_t landing = land();
    planned(landing, segments);
    for (const std::uint32_t segment : segments) {
      arrived(landing, segment);
    }
    ready(landing, segments);
    return landing;
  }

  void frames(int count) {
    for (int frame = 0; frame < count; ++frame) {
      update();
    }
  }

  SegmentSet visible() const { return {stage->visible().begin(), stage->visible().end()}; }

  /// What is drawn is what the stage says, and the base is hidden by the rule.
  void compare() const {
    if (stage->needsFiles()) {
      return;  // the old version's: its ids are not the new cover's
    }
    CHECK(renderer.shown == visible());
    // A cover names segments, whichever level of them is shown.
    SegmentSet covering;
    for (const std::uint32_t id : renderer.shown) {
      covering.insert(id % stage->files().manifest.segmentCount);
    }
    CHECK(renderer.drawn == hiddenBy(stage->files().cover, covering));
    const terraport::VisibleDigest digest = stage->visibleDigest();
    CHECK(digest.segments == renderer.shown.size());
    CHECK(digest.hiddenBaseFaces == std::count(renderer.drawn.begin(), renderer.drawn.end(), 1));
  }

  static terraport::SegmentFacts facts(std::uint32_t segment) {
    terraport::SegmentFacts out;
    out.segment = segment;
    out.length = 500;
    return out;
  }

  WorkClock clock;
  FakeStream stream;
  NotingRenderer renderer;
  terraport::InlineDecodes decodes;
  terraport::SharedSceneFiles files;
  std::unique_ptr<terraport::SceneStage> stage;

 private:
  void tell(terraport::EventKind kind, std::int64_t landing, const SegmentSet& segments, const SegmentSet& missing = {}) {
    terraport::StreamEvent event;
    event.kind = kind;
    event.landing = landing;
    event.segments.assign(segments.begin(), segments.end());
    event.missing.assign(missing.begin(), missing.end());
    event.message = "no";
    stage->handle(event);
  }
};

}  // namespace terraport_tests
