#include "Session.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "WebSocket.h"

namespace terraport::godot {

namespace {

/// Faces of the base that one swap makes anew at least: about half a millisecond.
constexpr std::uint32_t kBlockFaces = 2048;
/// Waits between attempts to load the base, doubled each time.
constexpr double kFirstRetryMs = 1000.0;
constexpr double kMaxRetryMs = 30'000.0;

double nowMs() {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// Nothing that a second attempt could change.
bool isFinal(const std::string& code) {
  return code != "unreachable" && code != "draining" && code != "too_many" && code != "server_full";
}

}  // namespace

Session::Session(SessionSettings settings, abi::Object* receiver)
    : settings_(std::move(settings)),
      receiver_(receiver),
      token_(settings_.token),
      autoShow_(settings_.autoShow),
      showsCoarse_(settings_.showsCoarse) {
  collider_ =
      std::make_unique<Collider>(settings_.space, settings_.draw.transform, settings_.colliderRadiusM, settings_.colliderLayer);
  renderer_ = std::make_unique<Renderer>(settings_.draw, *collider_);
  const auto afterDecode = [attribute = settings_.attribute](SegmentMesh& mesh, const SharedPayload& payload) {
    if (!mesh.engineData) mesh.engineData = std::make_unique<SegmentData>();
    static_cast<SegmentData&>(*mesh.engineData).build(mesh, viewOf(*payload), attribute);
  };
  decodes_ = std::make_unique<DecodeThreads>(
      static_cast<std::size_t>(std::max<std::int64_t>(settings_.decodeThreads, 1)), afterDecode);
  startLoading();
}

Session::~Session() {
  // The thread that sockets belong to ends first: they tell `receiver_` of themselves.
  if (stream_) stream_->close();
  loading_.reset();
  follower_.reset();
  stage_.reset();
  stream_.reset();
  decodes_.reset();
  renderer_.reset();
}

Variant Session::update(double budgetMs) {
  const double startMs = nowMs();
  EventList events;
  pollLoading(startMs, events);
  if (stream_) takeEvents(events);
  if (stage_) {
    stage_->setAutoShow(autoShow_);
    stage_->update([] { return nowMs(); }, std::max(startMs + budgetMs - nowMs(), 0.0));
    follower_->update();
  }
  // What is not urgent has the rest of the frame, one piece at least.
  bool hasMore = true;
  bool isFirst = true;
  while (hasMore && (isFirst || nowMs() < startMs + budgetMs)) {
    hasMore = renderer_->step() || collider_->step();
    isFirst = false;
  }
  for (const SceneSwap& swap : std::exchange(swaps_, {})) events.add(swap);
  tellPresentable(events);
  longestUpdateMs_ = std::max(longestUpdateMs_, nowMs() - startMs);
  return events.variant();
}

void Session::takeEvents(EventList& events) {
  StreamEvent event;
  while (stream_->tryNextEvent(event)) {
    if (event.kind == EventKind::Opened) {
      streamVersion_ = event.sceneVersion;
      // Published anew between the files and the connection.
      event.changed = event.changed || streamVersion_ != stage_->files().manifest.version;
    }
    stage_->handle(event);
    follower_->handle(event, nowMs());
    // Once for each connection that needs them: files that are damaged are not asked for again with every segment.
    if (event.kind == EventKind::Opened && stage_->needsFiles() && !loading_) {
      loadAttempt_ = 0;
      startLoading();
    }
    events.add(event);
  }
}

void Session::tellPresentable(EventList& events) {
  if (!stage_ || autoShow_ || !stage_->isPresentable()) return;
  const LandingStatus status = stage_->status();
  const bool isInFull = status.phase == LandingPhase::Presentable;
  if (status.landing == toldPresentable_ && (toldInFull_ || !isInFull)) return;
  toldPresentable_ = status.landing;
  toldInFull_ = isInFull;
  Dictionary facts;
  facts.set("landing", status.landing).set("degraded", !isInFull);
  events.add("presentable", facts);
}

void Session::startLoading() {
  retryAtMs_ = 0.0;
  ++loadAttempt_;
  LoadRequest request;
  request.url = settings_.url;
  request.token = token_;
  request.version = streamVersion_;
  request.blockFaces = kBlockFaces;
  request.attribute = settings_.attribute;
  loading_ = std::make_unique<Loading>(std::move(request));
}

void Session::pollLoading(double nowMs, EventList& events) {
  if (!loading_) {
    if (retryAtMs_ > 0.0 && nowMs >= retryAtMs_) startLoading();
    return;
  }
  LoadResult result;
  if (!loading_->poll(result)) return;
  loading_.reset();
  // The connection may have gone on to another version meanwhile. Ids in the cover belong to one: with another one's base there
  // would be holes.
  const bool isOfAnother = result.status.isOk() && stage_ && result.files->manifest.version != streamVersion_;
  if (result.status.isOk() && !isOfAnother) {
    loadAttempt_ = 0;
    return take(result, nowMs, events);
  }
  // A version that the server has given up since: the next connection names a newer one, whose files are then asked for.
  const bool isGone = !streamVersion_.empty() && result.status.code().compare(0, 7, "unknown") == 0;
  const bool isEnd = !result.status.isOk() && isFinal(result.status.code()) && !isGone;
  if (!isEnd) {
    const double doubled = kFirstRetryMs * double(1 << std::min(std::max(loadAttempt_ - 1, 0), 10));
    retryAtMs_ = nowMs + std::min(doubled, kMaxRetryMs);
  }
  if (!result.status.isOk()) events.failed(result.status.code(), result.status.text(), kNoLanding, isEnd);
}

void Session::take(LoadResult& result, double nowMs, EventList& events) {
  renderer_->setBase(result.base);
  if (stage_) {
    stage_->replaceFiles(result.files);
  } else {
    if (!makeStream(result.sceneUrl, events)) return;
    StageOptions options;
    options.spareGpuBytes = settings_.spareGpuBytes;
    options.baseBlockFaces = kBlockFaces;
    options.autoShow = autoShow_;
    options.showsCoarse = showsCoarse_;
    stage_ = std::make_unique<SceneStage>(*stream_, result.files, *renderer_, *decodes_, options);
    stage_->onSwap([this](const SceneSwap& swap) { swaps_.push_back(swap); });
    follower_ = std::make_unique<GroupFollower>(*stream_, *stage_);
    follower_->setFollows(followsGroup_);
    if (pending_) stage_->land(pending_->position, pending_->radiusM, pending_->options, nowMs);
    pending_.reset();
  }
  Dictionary facts;
  facts.set("version", result.files->manifest.version);
  events.add("opened", facts);
}

bool Session::makeStream(const std::string& sceneUrl, EventList& events) {
  StreamOptions options;
  options.sceneUrl = sceneUrl;
  options.token = token_;
  options.budgets.maxTriangles = settings_.maxTriangles;
  options.budgets.maxBytes = settings_.maxPayloadBytes;
  options.budgets.maxSegments = settings_.maxSegments;
  options.cacheBytes = settings_.cacheBytes;
  options.client = "terraport-godot";
  auto stream = StreamThread::make(options, makeWebSockets(receiver_));
  if (!stream.isOk()) {
    events.failed(stream.status().code(), stream.status().text(), kNoLanding, true);
    return false;
  }
  stream_ = stream.take();
  return true;
}

std::int64_t Session::land(const Vec3& position, double radiusM, const LandOptions& options) {
  collider_->setCentre(position);
  if (!stage_) {
    pending_ = Pending{position, radiusM, options};
    return 0;
  }
  return stage_->land(position, radiusM, options, nowMs());
}

void Session::aim(const Vec3& position, double radiusM) {
  if (stage_) stage_->aim(position, radiusM);
}

std::int64_t Session::pick(const Vec3& origin, const Vec3& direction) {
  if (!stream_) return -1;
  const auto request = stream_->pick(origin, direction);
  return request.isOk() ? static_cast<std::int64_t>(request.value()) : -1;
}

bool Session::show() {
  return stage_ && stage_->show();
}

void Session::setAutoShow(bool autoShow) {
  autoShow_ = autoShow;
}

void Session::setShowsCoarse(bool showsCoarse) {
  showsCoarse_ = showsCoarse;
  if (stage_) stage_->setShowsCoarse(showsCoarse);
}

void Session::reconnect(const std::string& token) {
  if (!token.empty()) token_ = token;
  if (stream_) stream_->reconnect(token);
  if ((!stage_ || stage_->needsFiles()) && !loading_) {
    loadAttempt_ = 0;
    startLoading();
  }
}

bool Session::joinGroup(const std::string& name, bool asGuide, const std::string& ownName) {
  const GroupRole role = asGuide ? GroupRole::Guide : GroupRole::Member;
  return follower_ && follower_->join(name, role, ownName).isOk();
}

void Session::leaveGroup() {
  if (follower_) follower_->leave();
}

bool Session::gather(const Vec3& position, double radiusM) {
  return follower_ && follower_->group() && stream_->gather(position, radiusM, std::nullopt, std::nullopt).isOk();
}

std::int64_t Session::goToGroup() {
  return follower_ ? std::max<std::int64_t>(follower_->goThere(nowMs()), 0) : 0;
}

void Session::setFollowsGroup(bool follows) {
  followsGroup_ = follows;
  if (follower_) follower_->setFollows(follows);
}

Variant Session::group() const {
  return follower_ ? describe(follower_->group()) : Variant();
}

Variant Session::cast(const Vec3& origin, const Vec3& direction, double maxM) const {
  GroundPoint point;
  std::int64_t segment = -1;
  if (!renderer_->cast(origin, direction, maxM, point, segment)) return Variant();
  Dictionary facts;
  const Vec3 position{origin.x + point.at * direction.x, origin.y + point.at * direction.y, origin.z + point.at * direction.z};
  facts.set("position", position).set("normal", point.normal).set("segment", segment);
  return facts.variant();
}

Variant Session::status() const {
  LandingStatus status;
  if (stage_) {
    status = stage_->status();
  } else if (pending_) {
    status.phase = LandingPhase::Planning;
    status.position = pending_->position;
    status.radiusM = pending_->radiusM;
  }
  return describe(status);
}

Variant Session::takeStats() {
  const StreamStats stream = stream_ ? stream_->stats() : StreamStats();
  const StageStats stage = stage_ ? stage_->stats() : StageStats();
  const auto count = [](std::uint64_t value) { return Variant(static_cast<std::int64_t>(value)); };
  Dictionary facts;
  facts.set("payload_bytes", count(stream.payloadBytes))
      .set("repeated_bytes", count(stream.repeatedBytes))
      .set("held_segments", count(stream.heldSegments))
      .set("held_bytes", count(stream.heldBytes))
      .set("segments", count(stage.segments))
      .set("visible_segments", count(stage.visibleSegments))
      .set("visible_triangles", count(stage.visibleTriangles))
      .set("gpu_bytes", count(stage.gpuBytes))
      .set("meshes", count(renderer_->meshCount()))
      .set("collision_shapes", count(collider_->shapeCount()))
      .set("longest_update_ms", std::exchange(longestUpdateMs_, 0.0));
  return facts.variant();
}

Variant Session::manifest() const {
  return stage_ ? describe(stage_->files().manifest) : Variant();
}

Variant Session::regions() const {
  return stage_ ? describe(stage_->files().regions) : List().variant();
}

Variant Session::places() const {
  return stage_ ? describe(placesOf(stage_->files().regions)) : List().variant();
}

Variant Session::coarserPieces(std::int64_t region) const {
  if (!stage_ || region < 0 || region > std::int64_t{0xFFFFFFFF}) return List().variant();
  const SceneFiles& files = stage_->files();
  return describe(terraport::coarserPieces(files.regions, files.unions, static_cast<std::uint32_t>(region)));
}

Variant Session::visible() const {
  if (!stage_) return arrayOf<std::int32_t>(0, [](std::int32_t*) {});
  const std::vector<std::uint32_t>& segments = stage_->visible();
  return arrayOf<std::int32_t>(segments.size(), [&](std::int32_t* out) { std::copy(segments.begin(), segments.end(), out); });
}

std::string Session::digest() const {
  return stage_ ? stage_->visibleDigest().text() : std::string();
}

Vec3 Session::toSurvey(const Vec3& position) const {
  return stage_ ? terraport::toSurvey(stage_->files().manifest, position) : position;
}

Vec3 Session::fromSurvey(const Vec3& survey) const {
  return stage_ ? terraport::fromSurvey(stage_->files().manifest, survey) : survey;
}

void Session::setTransform(const Variant& transform) {
  renderer_->setTransform(transform);
  collider_->setTransform(transform);
}

}  // namespace terraport::godot
