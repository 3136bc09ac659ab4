// What a stage holds, and how it goes on from frame to frame.
#pragma once

#include <unordered_map>
#include <vector>

#include "BaseBlocks.h"
#include "Residency.h"
#include "Terraport/SceneStage.h"

namespace terraport {

class SceneStage::Impl {
 public:
  Impl(LandingStream& stream, SharedSceneFiles files, SceneRenderer& renderer, DecodeQueue& decoders,
      const StageOptions& options);

  ~Impl();

  std::int64_t land(const Vec3& position, double radiusM, const LandOptions& options, double nowMs);
  void aim(const Vec3& position, double radiusM) { stream_.aim(position, radiusM, ringOf(radiusM)); }
  void handle(const StreamEvent& event);
  void update(const std::function<double()>& clockMs, double budgetMs);
  bool show();
  void replaceFiles(SharedSceneFiles files);
  bool isBusy() const;
  LandingStatus status() const;
  VisibleDigest visibleDigest() const;
  StageStats stats() const;

  PresentableExtent presentable() const {
    return isOldVersion_ || !isBaseReady_ ? PresentableExtent::Nothing : residency_.presentable();
  }

  LandingStream& stream_;
  bool autoShow_;
  bool showsCoarse_;
  bool isOldVersion_ = false;
  std::function<void(const SceneSwap&)> onSwap_;
  const SceneFiles& files() const { return *files_; }
  const Residency& residency() const { return residency_; }

 private:
  /// A segment of this scene version from its decoding until it is freed.
  struct StagedSegment {
    /// Until it is uploaded.
    std::unique_ptr<SegmentMesh> mesh;
    SharedPayload payload;
    std::size_t gpuBytes = 0;
    std::uint32_t faces = 0;
    /// Whether `upload` was called for it: then the renderer must be asked to free it.
    bool isBegun = false;
  };

  /// How far a landing shows the coarser level; absent where the scene has none, or nobody wants it.
  std::optional<double> ringOf(double radiusM) const;
  void beginBase();
  void leaveVersion();
  void askForDecodes();
  void takeDecoded();
  bool uploadStep(std::size_t& bytes);
  void endWarming();
  void freeSome();
  void freeStaged(std::uint32_t segment);
  void prepareBase();

  SceneRenderer& renderer_;
  DecodeQueue& decoders_;
  StageOptions options_;
  SharedSceneFiles files_;
  Residency residency_;
  BaseBlocks base_;
  bool isBaseReady_ = false;
  /// Everything decoded that is on its way to the renderer, or there, by id.
  std::unordered_map<std::uint32_t, StagedSegment> staged_;
  /// Uploaded, and asked once a frame whether they can be drawn.
  SegmentList warming_;
  /// Uploads that go on in the next frame.
  SegmentList unfinished_;
  /// To be freed, a few each frame.
  SegmentList freeing_;
  std::vector<ResidencyRequest> requests_;
  std::uint32_t segmentsHash_ = 0;
  std::size_t decodeFailures_ = 0;
};

}  // namespace terraport
