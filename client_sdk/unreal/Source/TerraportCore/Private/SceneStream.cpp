#include "Terraport/SceneStream.h"

#include "DiskShelf.h"
#include "Link.h"
#include "Session.h"
#include "Terraport/SceneUrl.h"
#include "Terraport/Xxh3.h"

#include <chrono>
#include <deque>
#include <map>
#include <random>
#include <utility>

namespace terraport {

namespace {

/// Picks that wait for an answer; a server answers far fewer at a time.
constexpr std::size_t kMaxPicks = 64;

/// Events that wait to be taken; beyond it nothing is received.
constexpr std::size_t kMaxWaitingEvents = 8192;

/// Of messages in one pump: about a millisecond of copying and hashing.
constexpr std::size_t kMaxPumpBytes = 4 * 1024 * 1024;

SessionOptions sessionOptions(const StreamOptions& options) {
  SessionOptions session;
  session.client = options.client;
  session.budgets = options.budgets;
  session.creditBytes = options.creditBytes;
  session.releaseFactor = options.releaseFactor;
  session.cacheBytes = options.cacheBytes;
  return session;
}

/// The scene's address over HTTP: its name on disk, the same for each form in which it was pasted.
std::string httpOf(const std::string& sceneUrl) {
  const Result<SceneUrl> url = parseSceneUrl(sceneUrl);
  if (!url.isOk()) return sceneUrl;
  const Result<std::string> http = sceneUrlOf(sceneUrl, url.value().scene);
  return http.isOk() ? http.value() : sceneUrl;
}

/// Numbers in [0, 1) that differ from one device to the next.
class Chance {
 public:
  Chance() {
    // Not every platform has a good random_device; the clock differs too.
    const auto ticks = std::chrono::high_resolution_clock::now().time_since_epoch().count();
    std::seed_seq seed{static_cast<std::uint32_t>(ticks), static_cast<std::uint32_t>(ticks >> 32), std::random_device{}()};
    engine_.seed(seed);
  }

  double operator()() { return std::uniform_real_distribution<double>(0, 1)(engine_); }

 private:
  std::minstd_rand engine_;
};

}  // namespace

struct SceneStream::Impl {
  Impl(const StreamOptions& options, std::string url, std::shared_ptr<TransportFactory> factory, std::function<double()> chance)
      : streamUrl(url),
        transports(std::move(factory)),
        session(sessionOptions(options), &xxh3Hash64),
        link(Link::Context{session, *transports, std::move(url), Access(options.token, options.tokenProvider),
            std::move(chance), [this](SessionEvent& event) { handle(event); },
            [this](const LinkState& state) { onLink(state); }, [this] { return events.size() < kMaxWaitingEvents; }}) {}

  void emit(StreamEvent event) { events.push_back(std::move(event)); }

  void onLink(const LinkState& state) {
    StreamEvent event;
    event.kind = EventKind::Link;
    event.link = state;
    emit(std::move(event));
    if (state.phase == LinkPhase::Closed) end(Status::failed(state.code, state.message));
  }

  /// Nobody answers any more: tell whoever waits.
  void end(const Status& status) {
    ended = status;
    for (const std::uint32_t request : session.dropPicks()) {
      StreamEvent event;
      event.kind = EventKind::PickRefused;
      event.request = request;
      event.code = status.code();
      event.message = status.message();
      emit(std::move(event));
    }
  }

  void handle(SessionEvent& event) {
    if (event.news == SessionNews::Rejected) return;
    StreamEvent& streamEvent = event.stream;
    const bool isOver = streamEvent.kind == EventKind::Ready || streamEvent.kind == EventKind::Superseded ||
        (streamEvent.kind == EventKind::Refused && streamEvent.landing != kNoLanding);
    if (isOver) {
      const auto requested = requestedAtMs.find(streamEvent.landing);
      if (requested != requestedAtMs.end()) {
        streamEvent.elapsedMs = link.nowMs() - requested->second;
        requestedAtMs.erase(requested);
      }
    }
    if (shelf) keep(streamEvent);
    if (!isClosed) emit(std::move(streamEvent));
  }

  /// Keep what came on disk, and note what a landing shows as used.
  void keep(const StreamEvent& event) {
    if (event.kind == EventKind::Arrived) {
      if (const CachedSegment* const entry = session.holdings().peek(event.facts.segment)) shelf->put(*entry);
    }
    if (event.kind != EventKind::Ready) return;
    for (const std::uint32_t segment : event.segments) {
      if (const auto facts = session.holdings().factsOf(segment)) shelf->use(*facts);
    }
  }

  /// Whether the connection may begin: what the disk had is held, and offered with the first hello.
  bool isRestored() {
    if (!hasRestored) {
      if (auto entries = shelf->takeRestored()) {
        // Used last comes last, and so is the most recently used in memory too.
        for (auto entry = entries->rbegin(); entry != entries->rend(); ++entry) session.restore(std::move(*entry));
        hasRestored = true;
      }
    }
    return hasRestored;
  }

  void refuse(const Status& status) {
    StreamEvent event;
    event.kind = EventKind::Refused;
    event.code = status.code();
    event.message = status.message();
    emit(std::move(event));
  }

  /// Of no group.
  std::string streamUrl;
  std::shared_ptr<TransportFactory> transports;
  ClientSession session;
  std::deque<StreamEvent> events;
  /// When each landing that is not over was asked for.
  std::map<std::int64_t, double> requestedAtMs;
  /// Why nothing is sent any more, until `reconnect`.
  Status ended;
  bool isClosed = false;
  std::size_t maxPumpBytes = kMaxPumpBytes;
  /// Null without a folder on disk.
  std::unique_ptr<DiskShelf> shelf;
  bool hasRestored = true;
  // Last, so that it parts from its transport before what it reports to is gone.
  Link link;
};

Result<std::unique_ptr<SceneStream>> SceneStream::make(
    const StreamOptions& options, std::shared_ptr<TransportFactory> transports, double (*chance)()) {
  Result<std::string> url = streamUrl(options.sceneUrl);
  if (!url.isOk()) return url.status();
  TERRAPORT_RETURN_IF_ERROR(checkSessionOptions(sessionOptions(options)));
  if (transports == nullptr) return Status::failed("invalid_argument", "got no transports");
  std::function<double()> draw = chance != nullptr ? std::function<double()>(chance) : std::function<double()>(Chance());
  auto impl = std::make_unique<Impl>(options, url.take(), std::move(transports), std::move(draw));
  if (!options.diskFolder.empty() && options.diskBytes > 0) {
    DiskCache cache(options.diskFolder, httpOf(options.sceneUrl), options.diskBytes);
    impl->shelf = std::make_unique<DiskShelf>(std::move(cache), options.cacheBytes);
    impl->hasRestored = false;
  }
  return std::unique_ptr<SceneStream>(new SceneStream(std::move(impl)));
}

SceneStream::SceneStream(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

SceneStream::~SceneStream() {
  close();
}

void SceneStream::pump(double nowMs) {
  if (impl_->isClosed || impl_->isRestored()) {
    impl_->link.pump(nowMs, impl_->maxPumpBytes);
  } else {
    impl_->link.wait(nowMs);
  }
}

void SceneStream::setMaxPumpBytes(std::size_t bytes) {
  impl_->maxPumpBytes = bytes;
}

std::int64_t SceneStream::land(const Vec3& position, double radiusM, const LandOptions& options) {
  const Status status = checkLand(position, radiusM, options);
  if (!status.isOk()) {
    impl_->refuse(status);
    return kNoLanding;
  }
  const std::int64_t number = impl_->session.land(position, radiusM, options);
  impl_->requestedAtMs[number] = impl_->link.nowMs();
  return number;
}

void SceneStream::aim(const Vec3& position, double radiusM, const std::optional<double>& coarseRadiusM) {
  const Status status = checkAim(position, radiusM, coarseRadiusM);
  if (status.isOk()) {
    impl_->session.aim(position, radiusM, coarseRadiusM);
  } else {
    impl_->refuse(status);
  }
}

Result<std::uint64_t> SceneStream::pick(const Vec3& origin, const std::optional<Vec3>& direction) {
  if (!impl_->ended.isOk()) return impl_->ended;
  TERRAPORT_RETURN_IF_ERROR(checkPick(origin, direction));
  if (impl_->session.openPicks() >= kMaxPicks) {
    return Status::failed("too_many", std::to_string(kMaxPicks) + " picks wait for an answer already");
  }
  return std::uint64_t{impl_->session.pick(origin, direction)};
}

Result<std::uint64_t> SceneStream::joinGroup(const std::string& group, GroupRole role, const std::string& ownName) {
  TERRAPORT_RETURN_IF_ERROR(checkJoin(group, role, ownName));
  impl_->session.leave();
  // Where several processes serve, the address says where the group lives (wire protocol, 16.6). Always, so that there is one
  // way; the seat is asked for with the next welcome.
  impl_->link.moveTo(impl_->streamUrl + "?group=" + group);
  return std::uint64_t{impl_->session.join(group, role, ownName)};
}

void SceneStream::leaveGroup() {
  impl_->session.leave();
}

Result<std::uint64_t> SceneStream::gather(const Vec3& position, double radiusM, const std::optional<double>& innerRadiusM,
    const std::optional<std::uint32_t>& deadlineMs) {
  TERRAPORT_RETURN_IF_ERROR(checkGather(position, radiusM, innerRadiusM, deadlineMs));
  return std::uint64_t{impl_->session.gather(position, radiusM, innerRadiusM, deadlineMs)};
}

void SceneStream::arrive(std::uint32_t gathering, GroupArrival how) {
  const Status status = impl_->session.arrive(gathering, how);
  if (!status.isOk()) impl_->refuse(status);
}

bool SceneStream::tryNextEvent(StreamEvent& event) {
  if (impl_->events.empty()) return false;
  std::swap(event, impl_->events.front());
  impl_->events.pop_front();
  return true;
}

SharedPayload SceneStream::payload(std::uint32_t segment) const {
  const CachedSegment* const entry = impl_->session.holdings().peek(segment);
  return entry == nullptr ? nullptr : entry->payload;
}

StreamStats SceneStream::stats() const {
  const Transfers& transfers = impl_->session.transfers();
  StreamStats stats;
  stats.payloadBytes = transfers.payloadBytes();
  stats.repeatedBytes = transfers.repeatedBytes();
  stats.heldSegments = impl_->session.holdings().count();
  stats.heldBytes = impl_->session.holdings().bytes();
  stats.aimedLandings = transfers.aims().landings;
  stats.aimHits = transfers.aims().hits;
  stats.prefetchedBytes = transfers.aims().prefetchedBytes;
  stats.usedPrefetchedBytes = transfers.aims().usedBytes;
  return stats;
}

void SceneStream::reconnect(const std::string& token) {
  if (impl_->isClosed) return;
  impl_->ended = Status::ok();
  // Whoever cannot wait begins without what is kept.
  impl_->hasRestored = true;
  impl_->link.reconnect(token);
}

void SceneStream::close() {
  if (impl_->isClosed) return;
  impl_->link.leave();
  impl_->end(Status::failed("closed", "the stream was closed here"));
  impl_->isClosed = true;
  impl_->shelf.reset();
}

}  // namespace terraport
