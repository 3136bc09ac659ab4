#include "Terraport/StreamThread.h"

#include "Session.h"

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <map>
#include <mutex>
#include <thread>
#include <utility>
#include <variant>
#include <vector>

namespace terraport {

namespace {

/// Between two looks at the network: while something came in the last second, and later. Commands wake the thread at once.
constexpr double kShortPauseMs = 1;
constexpr double kLongPauseMs = 10;
constexpr double kQuietMs = 1000;

/// As in SceneStream, which counts the picks that it knows; here are those on their way to it.
constexpr std::size_t kMaxWaitingPicks = 64;

/// Events that wait for the owner; the thread keeps the rest, and receives nothing more when that is full.
constexpr std::size_t kMaxKeptEvents = 8192;

struct LandCommand {
  Vec3 position;
  double radiusM = 0;
  LandOptions options;
};
struct AimCommand {
  Vec3 position;
  double radiusM = 0;
  std::optional<double> coarseRadiusM;
};
struct PickCommand {
  Vec3 origin;
  std::optional<Vec3> direction;
  std::uint64_t request = 0;
};
struct JoinCommand {
  std::string group;
  GroupRole role = GroupRole::Member;
  std::string ownName;
  std::uint64_t request = 0;
};
struct LeaveCommand {};
struct GatherCommand {
  Vec3 position;
  double radiusM = 0;
  std::optional<double> innerRadiusM;
  std::optional<std::uint32_t> deadlineMs;
  std::uint64_t request = 0;
};
struct ArriveCommand {
  std::uint32_t gathering = 0;
  GroupArrival how = GroupArrival::Ready;
};
struct ReconnectCommand {
  std::string token;
};
using Command = std::variant<LandCommand, AimCommand, PickCommand, JoinCommand, LeaveCommand, GatherCommand, ArriveCommand,
    ReconnectCommand>;

double nowMs() {
  using Milliseconds = std::chrono::duration<double, std::milli>;
  return std::chrono::duration_cast<Milliseconds>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace

struct StreamThread::Impl {
  explicit Impl(std::unique_ptr<SceneStream> sceneStream) : stream(std::move(sceneStream)) {}

  ~Impl() { stop(); }

  void start() {
    thread = std::thread([this] { run(); });
  }

  void stop() {
    {
      const std::lock_guard<std::mutex> lock(mutex);
      isStopping = true;
    }
    wake.notify_one();
    if (thread.joinable()) thread.join();
  }

  void enqueue(Command command) {
    {
      const std::lock_guard<std::mutex> lock(mutex);
      if (isStopping) return;
      // Only the newest aim counts; in one burst of them the older ones are never sent.
      if (std::holds_alternative<AimCommand>(command) && !commands.empty() &&
          std::holds_alternative<AimCommand>(commands.back())) {
        commands.back() = std::move(command);
      } else {
        commands.push_back(std::move(command));
      }
    }
    wake.notify_one();
  }

  /// On the thread.
  void run() {
    std::deque<Command> batch;
    double busyMs = nowMs();
    bool wasBusy = false;
    for (;;) {
      {
        std::unique_lock<std::mutex> lock(mutex);
        const double pauseMs = nowMs() - busyMs < kQuietMs ? kShortPauseMs : kLongPauseMs;
        if (!wasBusy) {
          wake.wait_for(
              lock, std::chrono::duration<double, std::milli>(pauseMs), [this] { return isStopping || !commands.empty(); });
        }
        if (isStopping) break;
        batch.swap(commands);
      }
      // The time first: a landing counts from it.
      stream->pump(nowMs());
      for (const Command& command : batch) std::visit([this](const auto& typedCommand) { obey(typedCommand); }, command);
      if (!batch.empty()) stream->pump(nowMs());
      wasBusy = passOn();
      if (wasBusy || !batch.empty()) busyMs = nowMs();
      batch.clear();
    }
    // On this thread, where its transports live.
    stream->close();
    passOn();
    stream.reset();
  }

  void obey(const LandCommand& land) { stream->land(land.position, land.radiusM, land.options); }
  void obey(const AimCommand& aim) { stream->aim(aim.position, aim.radiusM, aim.coarseRadiusM); }
  void obey(const ReconnectCommand& reconnect) { stream->reconnect(reconnect.token); }

  void obey(const LeaveCommand&) { stream->leaveGroup(); }
  void obey(const ArriveCommand& arrive) { stream->arrive(arrive.gathering, arrive.how); }

  // Both were checked where they were asked for.
  void obey(const JoinCommand& join) {
    const Result<std::uint64_t> request = stream->joinGroup(join.group, join.role, join.ownName);
    if (request.isOk()) groupRequestOf = {{request.value(), join.request}};
  }
  void obey(const GatherCommand& gather) {
    const Result<std::uint64_t> request =
        stream->gather(gather.position, gather.radiusM, gather.innerRadiusM, gather.deadlineMs);
    if (request.isOk()) groupRequestOf[request.value()] = gather.request;
  }

  void obey(const PickCommand& pick) {
    const Result<std::uint64_t> request = stream->pick(pick.origin, pick.direction);
    if (request.isOk()) {
      requestOf[request.value()] = pick.request;
      return;
    }
    StreamEvent event;
    event.kind = EventKind::PickRefused;
    event.request = pick.request;
    event.code = request.status().code();
    event.message = request.status().message();
    answers.push_back(std::move(event));
  }

  /// Hand events, payloads and counts to the owner; whether there was any event.
  bool passOn() {
    const StreamStats counted = stream->stats();
    std::size_t capacity = 0;
    {
      const std::lock_guard<std::mutex> lock(mutex);
      stats = counted;
      capacity = events.size() < kMaxKeptEvents ? kMaxKeptEvents - events.size() : 0;
    }
    std::vector<StreamEvent> deliveries = std::move(answers);
    answers.clear();
    StreamEvent event;
    while (deliveries.size() < capacity && stream->tryNextEvent(event)) {
      if (event.kind == EventKind::Picked || event.kind == EventKind::PickRefused) renumber(event, requestOf);
      if (event.kind == EventKind::GroupRefused) renumber(event, groupRequestOf);
      // Older gathers are answered by a newer landing of the group.
      if (event.kind == EventKind::GroupCalled && groupRequestOf.size() > kMaxWaitingPicks) groupRequestOf.clear();
      deliveries.push_back(std::move(event));
      event = StreamEvent();
    }
    if (deliveries.empty()) return false;
    const std::lock_guard<std::mutex> lock(mutex);
    for (StreamEvent& delivery : deliveries) {
      if (delivery.kind == EventKind::Arrived) {
        payloads[delivery.facts.segment] = stream->payload(delivery.facts.segment);
      } else if (delivery.kind == EventKind::Planned) {
        // Of an earlier run, on disk: nobody told that they came.
        for (const std::uint32_t segment : delivery.plan.keep) {
          if (payloads.count(segment) == 0) payloads[segment] = stream->payload(segment);
        }
      } else if (delivery.kind == EventKind::Dropped) {
        for (const std::uint32_t segment : delivery.segments) payloads.erase(segment);
      } else if (delivery.kind == EventKind::Picked || delivery.kind == EventKind::PickRefused) {
        openPicks -= openPicks > 0 ? 1 : 0;
      }
      events.push_back(std::move(delivery));
    }
    return true;
  }

  static void renumber(StreamEvent& event, std::map<std::uint64_t, std::uint64_t>& requests) {
    const auto entry = requests.find(event.request);
    if (entry == requests.end()) return;
    event.request = entry->second;
    requests.erase(entry);
  }

  // Of the thread alone.
  std::unique_ptr<SceneStream> stream;
  /// Our number of a pick by the stream's.
  std::map<std::uint64_t, std::uint64_t> requestOf;
  /// As that, of the newest join and the gathers after it.
  std::map<std::uint64_t, std::uint64_t> groupRequestOf;
  std::vector<StreamEvent> answers;

  // Of the owner alone.
  std::int64_t landings = 0;
  std::uint64_t requests = 0;
  std::thread thread;

  // Of both, by the mutex alone. Under it the stream is asked for a payload at most, and never pumped: the owner must not wait
  // for the network.
  std::mutex mutex;
  std::condition_variable wake;
  std::deque<Command> commands;
  std::deque<StreamEvent> events;
  std::map<std::uint32_t, SharedPayload> payloads;
  StreamStats stats;
  std::size_t openPicks = 0;
  bool isStopping = false;
};

Result<std::unique_ptr<StreamThread>> StreamThread::make(
    const StreamOptions& options, std::shared_ptr<TransportFactory> transports) {
  Result<std::unique_ptr<SceneStream>> stream = SceneStream::make(options, std::move(transports));
  if (!stream.isOk()) return stream.status();
  auto impl = std::make_unique<Impl>(stream.take());
  impl->start();
  return std::unique_ptr<StreamThread>(new StreamThread(std::move(impl)));
}

StreamThread::StreamThread(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

StreamThread::~StreamThread() = default;

std::int64_t StreamThread::land(const Vec3& position, double radiusM, const LandOptions& options) {
  const Status status = checkLand(position, radiusM, options);
  // A number that cannot be goes on too: the refusal then comes in its place among the events.
  impl_->enqueue(LandCommand{position, radiusM, options});
  if (!status.isOk()) return kNoLanding;
  // As the session counts: landings that it takes, in the order in which they are asked for.
  impl_->landings += 1;
  return impl_->landings;
}

void StreamThread::aim(const Vec3& position, double radiusM, const std::optional<double>& coarseRadiusM) {
  impl_->enqueue(AimCommand{position, radiusM, coarseRadiusM});
}

Result<std::uint64_t> StreamThread::pick(const Vec3& origin, const std::optional<Vec3>& direction) {
  TERRAPORT_RETURN_IF_ERROR(checkPick(origin, direction));
  {
    const std::lock_guard<std::mutex> lock(impl_->mutex);
    if (impl_->isStopping) return Status::failed("closed", "the stream was closed here");
    if (impl_->openPicks >= kMaxWaitingPicks) {
      return Status::failed("too_many", std::to_string(kMaxWaitingPicks) + " picks wait for an answer already");
    }
    impl_->openPicks += 1;
  }
  impl_->requests += 1;
  impl_->enqueue(PickCommand{origin, direction, impl_->requests});
  return impl_->requests;
}

Result<std::uint64_t> StreamThread::joinGroup(const std::string& group, GroupRole role, const std::string& ownName) {
  TERRAPORT_RETURN_IF_ERROR(checkJoin(group, role, ownName));
  impl_->requests += 1;
  impl_->enqueue(JoinCommand{group, role, ownName, impl_->requests});
  return impl_->requests;
}

void StreamThread::leaveGroup() {
  impl_->enqueue(LeaveCommand{});
}

Result<std::uint64_t> StreamThread::gather(const Vec3& position, double radiusM, const std::optional<double>& innerRadiusM,
    const std::optional<std::uint32_t>& deadlineMs) {
  TERRAPORT_RETURN_IF_ERROR(checkGather(position, radiusM, innerRadiusM, deadlineMs));
  impl_->requests += 1;
  impl_->enqueue(GatherCommand{position, radiusM, innerRadiusM, deadlineMs, impl_->requests});
  return impl_->requests;
}

void StreamThread::arrive(std::uint32_t gathering, GroupArrival how) {
  impl_->enqueue(ArriveCommand{gathering, how});
}

bool StreamThread::tryNextEvent(StreamEvent& event) {
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  if (impl_->events.empty()) return false;
  std::swap(event, impl_->events.front());
  impl_->events.pop_front();
  return true;
}

SharedPayload StreamThread::payload(std::uint32_t segment) const {
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  const auto entry = impl_->payloads.find(segment);
  return entry == impl_->payloads.end() ? nullptr : entry->second;
}

StreamStats StreamThread::stats() const {
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  return impl_->stats;
}

void StreamThread::reconnect(const std::string& token) {
  impl_->enqueue(ReconnectCommand{token});
}

void StreamThread::close() {
  impl_->stop();
}

}  // namespace terraport
