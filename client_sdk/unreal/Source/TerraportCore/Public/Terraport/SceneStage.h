// The shown scene: which segments an engine has, and the swap between two landings.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "Terraport/Api.h"
#include "Terraport/DecodeQueue.h"
#include "Terraport/LandingStream.h"
#include "Terraport/SceneFiles.h"
#include "Terraport/SceneRenderer.h"
#include "Terraport/Types.h"

namespace terraport {

/// Bounds of a stage.
struct StageOptions {
  /// GPU bytes of segments that nothing shows or waits for: what an aim brought.
  std::size_t spareGpuBytes = std::size_t{128} * 1024 * 1024;
  /// Segments being decoded, or decoded and not uploaded, at a time; and their GPU bytes.
  std::size_t maxInFlight = 16;
  std::size_t maxInFlightBytes = std::size_t{64} * 1024 * 1024;
  /// Segments given back to the engine in one frame.
  std::size_t maxFrameFrees = 8;
  /// Bytes handed to the renderer in one frame, however fast it takes them: what a driver puts off it does later, where nobody
  /// measures it.
  std::size_t maxFrameBytes = std::size_t{6} * 1024 * 1024;
  /// Base faces prepared at once.
  std::uint32_t baseBlockFaces = 4096;
  /// Landings and aims of a scene with a coarser level ask for a ring of it, to three times the radius, where they name none.
  /// Off: full detail alone.
  bool showsCoarse = true;
  /// Show a landing as soon as it can be. Otherwise only `show` does, for instance in the black frame of a fade.
  bool autoShow = true;
};

/// How the newest landing stands.
enum class LandingPhase : std::uint8_t {
  /// There was none yet.
  None,
  /// Asked for; its plan is not here.
  Planning,
  /// Payloads come and are made drawable.
  Loading,
  /// `show` would show it (autoShow is off): its inner part, or all of it.
  PresentableDegraded,
  Presentable,
  /// It is what is drawn: its inner part, or all of it.
  ShownDegraded,
  Shown,
  /// The server said no; what was shown stays.
  Refused,
};

/// The newest landing, for a progress bar or a fade.
struct LandingStatus {
  LandingPhase phase = LandingPhase::None;
  std::int64_t landing = kNoLanding;
  Vec3 position;
  double radiusM = 0.0;
  /// 0 where there is no plan yet.
  double effectiveRadiusM = 0.0;
  /// Share of its bytes that came and was made drawable, 0 to 1.
  double fraction = 0.0;
  /// Segments of it that are not to be had: they stay base. Ascending.
  std::vector<std::uint32_t> missing;
  /// Why it was refused.
  std::string refusal;
  /// From `land` until all bytes were here, and until it could be shown; negative where it is not so far.
  double readyMs = -1.0;
  double presentableMs = -1.0;
  std::uint64_t payloadBytes = 0;
};

/// What is drawn, as counts and hashes that do not depend on the order: equal exactly where the same is drawn.
struct VisibleDigest {
  std::uint32_t segments = 0;
  std::uint32_t segmentsHash = 0;
  std::uint32_t hiddenBaseFaces = 0;
  std::uint32_t hiddenBaseHash = 0;

  /// As the web client writes it: "segments:hash:faces:hash", counts in decimal, hashes in hexadecimal digits.
  std::string text() const;
};

struct StageStats {
  /// Segments that the renderer has, and of these the visible ones.
  std::size_t segments = 0;
  std::size_t visibleSegments = 0;
  std::size_t visibleTriangles = 0;
  /// By SceneRenderer::gpuBytesOf.
  std::size_t gpuBytes = 0;
  std::size_t spareGpuBytes = 0;
  std::size_t decodeFailures = 0;
};

/// Carries landings from the stream's events to the renderer. What is visible changes in a swap alone: exactly to what the
/// newest landing's `ready` (or `degraded`) said, once all of it is drawable and the base's hidden faces are prepared.
///
/// Not thread-safe: one thread (the engine's) makes it and calls everything. Stream, renderer and queue must outlive it.
class TERRAPORTCORE_API SceneStage {
 public:
  SceneStage(LandingStream& stream, SharedSceneFiles files, SceneRenderer& renderer, DecodeQueue& decoders,
      const StageOptions& options = {});
  /// Frees every segment at the renderer.
  ~SceneStage();
  SceneStage(const SceneStage&) = delete;
  SceneStage& operator=(const SceneStage&) = delete;

  /// As LandingStream::land. `nowMs` is any clock that does not run backwards, the same one as for `update`.
  std::int64_t land(const Vec3& position, double radiusM, const LandOptions& options, double nowMs);
  void aim(const Vec3& position, double radiusM);

  /// Pass every event of the stream on.
  void handle(const StreamEvent& event);

  /// Once per frame: asks for decodes, makes segments drawable, frees, prepares the base, and shows the newest landing where it
  /// can be and is to be shown. Works for at most `budgetMs` by `clockMs`, but for the step in hand when it is used up; one
  /// step at least is done.
  void update(const std::function<double()>& clockMs, double budgetMs);

  /// Whether a swap would show the newest landing, in full or its inner part.
  bool isPresentable() const;

  /// Show the presentable set now, once: in the next black frame, for instance. False where nothing is presentable.
  bool show();

  /// Whether landings and aims from now on ask for a ring of the coarser level: `StageOptions::showsCoarse`.
  void setShowsCoarse(bool showsCoarse);

  /// Whether a landing is shown as soon as it can be.
  void setAutoShow(bool autoShow);

  /// After an `opened` event with `changed`: the new version's files. Until then the old version stays drawn; from here on its
  /// base alone, until the next swap.
  void replaceFiles(SharedSceneFiles files);

  /// Whether an `opened` event with `changed` came, and `replaceFiles` did not yet.
  bool needsFiles() const;

  /// Whether `update` has something to do that was not asked for from outside.
  bool isBusy() const;

  /// Ids of payloads shown, ascending: from the manifest's segmentCount on those of the coarser level.
  const std::vector<std::uint32_t>& visible() const;
  LandingStatus status() const;
  VisibleDigest visibleDigest() const;
  StageStats stats() const;
  const SceneFiles& files() const;

  /// What swaps did, for tests and statistics: null unless set. Called at the end of each swap.
  void onSwap(std::function<void(const SceneSwap&)> listener);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace terraport
