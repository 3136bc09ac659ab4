// From landings to what is drawn: decodes, uploads within a frame's budget, and the swap in one frame.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "Core/DiskCache.h"
#include "Core/Ground.h"
#include "Core/Scene.h"
#include "Core/Session.h"

namespace terraport {

/// What an engine makes of a decoded segment on a worker thread, until it is uploaded.
class PreparedSegment {
 public:
  virtual ~PreparedSegment() = default;
  SharedGround ground;
  /// By the engine's own reckoning.
  std::size_t gpuBytes = 0;
  std::uint32_t faces = 0;
};

struct DecodeJob {
  Key key = 0;
  /// Null: read it from disk, where its box is `box`.
  SharedBytes payload;
  Box box;
  /// It came by the network, and is written to disk.
  bool isNew = false;
  /// It will be shown; else its box and checksums are enough.
  bool isWanted = false;
  SharedScene scene;
};

struct DecodeResult {
  DecodeJob job;
  Status status;
  /// Null unless it was wanted.
  std::unique_ptr<PreparedSegment> prepared;
  /// Whether it was written to disk, and what was deleted for it.
  bool isStored = false;
  Keys removed;
};

/// Reads, decodes and writes on worker threads. `push` and `tryPop` are called by one thread.
class Decoder {
 public:
  virtual ~Decoder() = default;
  virtual void push(DecodeJob job) = 0;
  virtual bool tryPop(DecodeResult& result) = 0;
};

/// What a worker does with a job: everything but `prepare`, which makes the engine's part of a wanted segment's mesh.
using Prepare = std::function<std::unique_ptr<PreparedSegment>(const SegmentMesh&, ByteSpan payload, const Scene&)>;
DecodeResult runDecode(DecodeJob job, DiskCache& disk, SegmentDecoder& decoder, SegmentMesh& mesh, const Prepare& prepare);

/// One change of what is drawn.
struct Swap {
  std::int64_t landing = 0;
  /// The inner set alone.
  bool isInner = false;
  std::vector<Key> shown, hidden;
  /// Base faces that are hidden from now on.
  FaceBits hiddenFaces;
};

/// Draws by an engine. What `upload` and `stepBase` make is not seen before `swap`.
class Renderer {
 public:
  enum class UploadState : std::uint8_t { More, Done, Failed };

  virtual ~Renderer() = default;
  /// One step of making a segment drawable; called again for More.
  virtual UploadState upload(Key key, PreparedSegment& prepared) = 0;
  /// Whether what was uploaded can be drawn in this frame.
  virtual bool isDrawable(Key key) = 0;
  virtual void free(Key key) = 0;
  /// One step of the base that `showBase` will show; false where nothing is left to do.
  virtual bool stepNewBase() = 0;
  /// Show the new base, nothing of it hidden, and free the one before.
  virtual void showBase() = 0;
  /// One step of preparing the base for a swap with these hidden faces; false where it is prepared.
  virtual bool stepBase(const FaceBits& hiddenFaces) = 0;
  virtual void swap(const Swap& change) = 0;
};

struct LandOptions {
  std::optional<double> coarseRadiusM;
  /// The inner set is shown alone where the deadline, or so long without progress, is over before the rest is there; 0: never.
  std::optional<double> innerRadiusM;
  double deadlineMs = 0.0;
  double stallMs = 0.0;
};

enum class LandingPhase : std::uint8_t { None, Planning, Loading, PresentableInner, Presentable, ShownInner, Shown, Refused };

struct LandingStatus {
  LandingPhase phase = LandingPhase::None;
  std::int64_t landing = 0;
  /// Share that came and can be drawn.
  double fraction = 0.0;
  /// From `land`; negative until then.
  double readyMs = -1.0, presentableMs = -1.0;
  std::string refusal;
};

struct StageStats {
  std::size_t segments = 0, visibleSegments = 0, visibleTriangles = 0, gpuBytes = 0;
};

/// What is visible is a function of the last landing that was shown. One thread; session, decoder and renderer outlive it.
class Stage {
 public:
  Stage(Session& session, Decoder& decoder, Renderer& renderer) : session_(session), decoder_(decoder), renderer_(renderer) {}

  /// The scene of the newest connection; the renderer has begun its base. Until that can be drawn the one before stays.
  void setScene(SharedScene scene, SharedGround base);
  const SharedScene& scene() const { return scene_; }
  /// Whether the connection serves another version than the scene.
  bool needsScene() const { return scene_ == nullptr || scene_->version != version_; }

  void setAutoShow(bool isAutoShow) { isAutoShow_ = isAutoShow; }
  /// Whether landings and aims ask for a ring of the coarser level to three times the radius, where the scene has one.
  void setShowsCoarse(bool showsCoarse) { showsCoarse_ = showsCoarse; }

  /// The landing's number, or -1.
  std::int64_t land(const Vec3& position, double radiusM, const LandOptions& options, double nowMs);
  bool aim(const Vec3& position, double radiusM);

  /// Takes every event of the session.
  void handle(const Event& event, double nowMs);

  /// Once a frame: works for about `budgetMs`, one step at least; shows the newest landing where it can be shown by itself.
  void update(const std::function<double()>& clockMs, double budgetMs);

  bool isPresentable() const;
  /// Show what is presentable, now. False where nothing is.
  bool show();

  LandingStatus status() const { return status_; }
  double elapsedMs(double nowMs) const { return nowMs - landedAtMs_; }
  StageStats stats() const;
  const ShownGround& ground() const { return ground_; }
  /// Swaps since the last call.
  std::vector<Swap> takeSwaps() { return std::exchange(swaps_, {}); }
  /// Rows that are visible, by key.
  const std::map<Key, SegmentRow>& visible() const { return visible_; }
  const FaceBits& hiddenFaces() const { return hiddenFaces_; }

 private:
  enum class PieceState : std::uint8_t { Prepared, Uploaded, Drawable, Failed };
  struct Piece {
    PieceState state = PieceState::Prepared;
    bool isBegun = false;
    std::unique_ptr<PreparedSegment> prepared;
    SharedGround ground;
    std::size_t gpuBytes = 0;
    std::uint32_t faces = 0;
  };
  /// A set that is shown as soon as its pieces can be drawn.
  struct Target {
    std::int64_t landing = 0;
    bool isInner = false;
    std::vector<SegmentRow> rows;
    FaceBits hidden;
    /// Whether the renderer has prepared the base for it.
    bool isBasePrepared = false;
  };

  void begin(std::int64_t landing, double nowMs);
  void setTarget(std::int64_t landing, bool isInner, const std::vector<SegmentRow>& rows, const FaceBits& hidden);
  void askFor(const Planned& planned);
  void pushJobs();
  void takeResults(double nowMs);
  bool uploadOne();
  void freeSome();
  void showNewBase();
  void watchDeadline(double nowMs);
  void updateStatus(double nowMs);
  void setGround();
  const Piece* piece(Key key) const;
  bool isNeeded(Key key) const { return wanted_.count(key) > 0 || visible_.count(key) > 0; }

  Session& session_;
  Decoder& decoder_;
  Renderer& renderer_;
  SharedScene scene_;
  /// Of the newest connection.
  std::string version_;
  double maxRadiusM_ = kMaxRadiusM;
  SharedGround newBase_, base_;
  bool isBaseShown_ = false;
  bool isAutoShow_ = true, showsCoarse_ = true;
  std::deque<DecodeJob> jobs_;
  std::size_t inFlight_ = 0;
  std::map<Key, Piece> pieces_;
  /// Rows of the newest plan, by key, and in its order.
  std::map<Key, SegmentRow> wanted_;
  std::vector<SegmentRow> order_;
  std::optional<Target> target_;
  std::map<Key, SegmentRow> visible_;
  FaceBits hiddenFaces_;
  ShownGround ground_;
  LandingStatus status_;
  LandOptions options_;
  double landedAtMs_ = 0.0, progressAtMs_ = 0.0;
  bool isHurried_ = false;
  std::vector<Swap> swaps_;
};

}  // namespace terraport
