// One open scene: files, stream, decoding, drawing. The core's parts, put together for the engine's main thread.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "Collider.h"
#include "Events.h"
#include "Godot.h"
#include "Loading.h"
#include "Renderer.h"
#include "Terraport/DecodeThreads.h"
#include "Terraport/GroupFollower.h"
#include "Terraport/SceneStage.h"
#include "Terraport/StreamThread.h"

namespace terraport::godot {

struct SessionSettings {
  std::string url;
  std::string token;
  /// Of the survey; the one whose values are drawn. Empty for none.
  std::string attribute;
  DrawSettings draw;
  /// RID of the world's physics space.
  Variant space;
  double colliderRadiusM = 0.0;
  std::int64_t colliderLayer = 1;
  std::uint64_t maxTriangles = 3'000'000;
  std::uint64_t maxSegments = 2'048;
  std::uint64_t maxPayloadBytes = 128ull * 1024 * 1024;
  std::uint64_t cacheBytes = 96ull * 1024 * 1024;
  std::uint64_t spareGpuBytes = 128ull * 1024 * 1024;
  std::int64_t decodeThreads = 2;
  bool autoShow = true;
  bool showsCoarse = true;
};

/// Main thread, but for what its own threads do.
class Session {
 public:
  /// Begins to load. Signals of sockets go to `receiver` (WebSocket.h), which must outlive this.
  Session(SessionSettings settings, abi::Object* receiver);
  ~Session();
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  /// Once a frame: at most `budgetMs`, but for the step in hand. Returns what happened, a list of [name, facts].
  Variant update(double budgetMs);

  /// Before the base is here the newest one is kept, and 0 returned.
  std::int64_t land(const Vec3& position, double radiusM, const LandOptions& options);
  void aim(const Vec3& position, double radiusM);
  /// -1 where it cannot be asked.
  std::int64_t pick(const Vec3& origin, const Vec3& direction);
  bool show();
  void setAutoShow(bool autoShow);
  void setShowsCoarse(bool showsCoarse);
  void reconnect(const std::string& token);
  /// Before the base is here nobody can join; false then, and where a name cannot be.
  bool joinGroup(const std::string& name, bool asGuide, const std::string& ownName);
  void leaveGroup();
  /// Land the group. False without a seat, and where a number cannot be.
  bool gather(const Vec3& position, double radiusM);
  /// Land where the group is, though that was not followed; the landing's number, 0 where the group is nowhere.
  std::int64_t goToGroup();
  void setFollowsGroup(bool follows);
  /// Nil without a seat.
  Variant group() const;
  /// Facts of where a ray meets what is shown; nil where it does not.
  Variant cast(const Vec3& origin, const Vec3& direction, double maxM) const;
  Variant status() const;
  /// Counts; the longest update since they were asked for last.
  Variant takeStats();
  /// Nil before the base is here.
  Variant manifest() const;
  Variant regions() const;
  Variant places() const;
  Variant coarserPieces(std::int64_t region) const;
  Variant visible() const;
  std::string digest() const;
  Vec3 toSurvey(const Vec3& position) const;
  Vec3 fromSurvey(const Vec3& survey) const;

  void setTransform(const Variant& transform);
  Renderer& renderer() { return *renderer_; }

 private:
  struct Pending {
    Vec3 position;
    double radiusM = 0.0;
    LandOptions options;
  };

  void startLoading();
  void pollLoading(double nowMs, EventList& events);
  void take(LoadResult& result, double nowMs, EventList& events);
  bool makeStream(const std::string& sceneUrl, EventList& events);
  void takeEvents(EventList& events);
  void tellPresentable(EventList& events);

  const SessionSettings settings_;
  abi::Object* receiver_;
  std::string token_;
  std::unique_ptr<Collider> collider_;
  std::unique_ptr<Renderer> renderer_;
  std::unique_ptr<DecodeThreads> decodes_;
  std::unique_ptr<Loading> loading_;
  std::unique_ptr<StreamThread> stream_;
  std::unique_ptr<SceneStage> stage_;
  std::unique_ptr<GroupFollower> follower_;
  std::optional<Pending> pending_;
  std::vector<SceneSwap> swaps_;
  /// Version that the connection serves; empty before it is open.
  std::string streamVersion_;
  int loadAttempt_ = 0;
  double retryAtMs_ = 0.0;
  bool autoShow_;
  bool showsCoarse_;
  bool followsGroup_ = true;
  std::int64_t toldPresentable_ = kNoLanding;
  bool toldInFull_ = false;
  double longestUpdateMs_ = 0.0;
};

}  // namespace terraport::godot
