// terraport-land --scene URL [--NAME VALUE ...] STEP ...
//
// Visits a scene step by step, over libwebsockets, and prints one JSON object: the events, the landings, the picks, and digests
// of what the held payloads decode to. Exit code 0 where the last landing became ready.

#include <chrono>
#include <cstdio>
#include <map>
#include <memory>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "Terraport/DecodeQueue.h"
#include "Terraport/SceneStream.h"
#include "Terraport/SegmentMesh.h"
#include "Terraport/StreamThread.h"
#include "event_json.h"
#include "files.h"
#include "land_options.h"
#include "lws_transport.h"
#include "mesh_arrays.h"
#include "staged_visit.h"

namespace terraport::tools {
namespace {

class Visit {
 public:
  explicit Visit(const LandRequest& request)
      : request_(request), token_(request.stream.token), events_(), landings_(), picks_() {}

  int run() {
    if (!open()) {
      return 2;
    }
    if (request_.isStaged) {
      files_ = loadFiles(request_.stream.sceneUrl, request_.stream.token, failure_);
      if (!files_) {
        std::fprintf(stderr, "error: %s\n", failure_.c_str());
        return 2;
      }
      staged_ = std::make_unique<StagedVisit>(*stream_, files_);
    }
    for (const Step& step : request_.steps) {
      take(step);
    }
    print();
    stream_->close();
    return failure_.empty() ? 0 : 1;
  }

 private:
  using Clock = std::chrono::steady_clock;

  bool open() {
    std::shared_ptr<TransportFactory> transports = makeLwsTransports();
    if (request_.isThreaded) {
      auto opened = StreamThread::make(request_.stream, transports);
      return opened.isOk() ? (stream_ = opened.take(), true) : refuse(opened.status());
    }
    auto opened = SceneStream::make(request_.stream, transports);
    if (!opened.isOk()) {
      return refuse(opened.status());
    }
    std::unique_ptr<SceneStream> own = opened.take();
    pumped_ = own.get();
    stream_ = std::move(own);
    return true;
  }

  static bool refuse(const Status& status) {
    std::fprintf(stderr, "error: %s: %s\n", status.code().c_str(), status.text().c_str());
    return false;
  }

  double nowMs() const { return std::chrono::duration<double, std::milli>(Clock::now() - began_).count(); }

  void take(const Step& step) {
    const auto& numbers = step.numbers;
    const auto position = [&numbers](std::size_t at) { return Vec3{numbers[at], numbers[at + 1], numbers[at + 2]}; };
    if (step.kind == "land" || step.kind == "start") {
      LandOptions options;
      if (numbers.size() >= 6) {
        options.innerRadiusM = numbers[4];
        options.deadlineMs = static_cast<std::uint32_t>(numbers[5]);
      }
      landing_ =
          staged_ ? staged_->land(position(0), numbers[3], options, nowMs()) : stream_->land(position(0), numbers[3], options);
      const bool isStart = step.kind == "start";
      until(step, [this, isStart] { return isStart ? planned_ == landing_ : isShown(); });
    } else if (step.kind == "wait") {
      until(step, [this] { return isShown(); });
    } else if (step.kind == "aim") {
      const int before = prefetched_;
      staged_ ? staged_->aim(position(0), numbers[3]) : stream_->aim(position(0), numbers[3]);
      until(step, [this, before] { return prefetched_ > before; });
    } else if (step.kind == "pick") {
      const int before = picked_;
      std::optional<Vec3> direction;
      if (numbers.size() >= 6) {
        direction = position(3);
      }
      auto request = stream_->pick(position(0), direction);
      if (!request.isOk()) {
        failure_ = step.text + ": " + request.status().code();
        return;
      }
      until(step, [this, before] { return picked_ > before; });
    } else if (step.kind == "join") {
      std::vector<std::string> fields(3);
      std::istringstream argument(step.argument);
      for (std::string& field : fields) std::getline(argument, field, ',');
      const int before = joined_;
      if (!stream_->joinGroup(fields[0], fields[1] == "guide" ? GroupRole::Guide : GroupRole::Member, fields[2]).isOk()) {
        failure_ = step.text + ": a name that cannot be";
        return;
      }
      until(step, [this, before] { return joined_ > before; });
    } else if (step.kind == "leave") {
      stream_->leaveGroup();
    } else if (step.kind == "gather") {
      const int before = called_;
      if (!stream_->gather(position(0), numbers[3], std::nullopt, std::nullopt).isOk()) {
        failure_ = step.text + ": numbers that cannot be";
        return;
      }
      until(step, [this, before] { return called_ > before; });
    } else if (step.kind == "people") {
      until(step, [this, &numbers] { return static_cast<double>(people_) >= numbers[0]; });
    } else if (step.kind == "barrier") {
      until(step, [this, &numbers] { return gathered_ >= numbers[0]; });
    } else if (step.kind == "follow" && staged_) {
      staged_->setFollows(numbers[0] != 0.0);
    } else if (step.kind == "stand" && staged_) {
      staged_->stand(position(0));
    } else if (step.kind == "pause") {
      const double end = nowMs() + numbers[0];
      until(step, [this, end] { return nowMs() >= end; });
    } else if (step.kind == "reconnect") {
      closedCode_.clear();
      stream_->reconnect(step.argument);
      if (!step.argument.empty()) {
        token_ = step.argument;
      }
    }
  }

  bool isShown() const { return ready_ == landing_ && (!staged_ || staged_->isShown()); }

  /// Pump until something holds. What ends a step early is told as the failure; a later landing that succeeds forgets it.
  template <typename Reached>
  void until(const Step& step, Reached reached) {
    refusedCode_.clear();
    while (!reached()) {
      if (nowMs() > request_.timeoutS * 1000.0) {
        failure_ = step.text + ": timeout";
        return;
      }
      const bool isRefusable =
          step.kind == "land" || step.kind == "start" || step.kind == "wait" || step.kind == "join" || step.kind == "gather";
      if (isRefusable && !refusedCode_.empty()) {
        failure_ = step.text + ": refused: " + refusedCode_;
        return;
      }
      if (step.kind != "pause" && !closedCode_.empty()) {
        failure_ = step.text + ": closed: " + closedCode_;
        return;
      }
      if (pumped_ != nullptr) {
        pumped_->pump(nowMs());
      }
      StreamEvent event;
      bool any = false;
      while (stream_->tryNextEvent(event)) {
        any = true;
        note(event);
        if (staged_) {
          staged_->handle(event);
        }
      }
      if (staged_) {
        staged_->frame();
      }
      if (!any) {
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
    }
    if (step.kind != "pause") {
      failure_.clear();
    }
  }

  void note(const StreamEvent& event) {
    describeEvent(events_, event);
    switch (event.kind) {
      case EventKind::Planned:
        planned_ = event.landing;
        break;
      case EventKind::Arrived:
        held_[event.facts.segment] = event.facts;
        break;
      case EventKind::Dropped:
        for (const std::uint32_t segment : event.segments) {
          held_.erase(segment);
        }
        break;
      case EventKind::Ready:
        ready_ = event.landing;
        describeEvent(landings_, event);
        break;
      case EventKind::Refused:
        if (event.landing == landing_ && !event.fatal) {  // what ends the session is told by the link as well
          refusedCode_ = event.code;
        }
        break;
      case EventKind::Prefetched:
        ++prefetched_;
        break;
      case EventKind::Picked:
      case EventKind::PickRefused:
        ++picked_;
        describeEvent(picks_, event);
        break;
      case EventKind::GroupJoined:
        ++joined_;
        break;
      case EventKind::GroupRoster:
        people_ = event.group->members.size();
        break;
      case EventKind::GroupCalled:
        ++called_;
        break;
      case EventKind::GroupGathered:
        gathered_ = int(event.group->gathering.number);
        break;
      case EventKind::GroupRefused:
        refusedCode_ = event.code;
        break;
      case EventKind::Link:
        closedCode_ = event.link.phase == LinkPhase::Closed ? event.link.code : "";
        break;
      default:
        break;
    }
  }

  void describeHeld(JsonText& json) {
    // A visit that is not staged needs the scales of attributes, and no other file.
    std::string failure;
    if (!files_ && !held_.empty()) {
      files_ = loadManifest(
          request_.stream.sceneUrl, request_.stream.tokenProvider ? request_.stream.tokenProvider() : token_, failure);
    }
    if (failure_.empty()) {
      failure_ = failure;
    }
    SegmentMesh mesh;
    json.open('{');
    for (const auto& [segment, facts] : held_) {
      DecodeJob job;
      job.segment = segment;
      job.payload = stream_->payload(segment);
      job.files = files_;
      if (!job.payload) {
        continue;
      }
      json.key(std::to_string(segment));
      const Status status = decodePayload(job, mesh);
      if (!status.isOk()) {
        if (failure_.empty()) {
          failure_ = "segment " + std::to_string(segment) + ": " + status.text();
        }
        json.null();
        continue;
      }
      MeshArrays(mesh, viewOf(*job.payload)).describe(json, request_.dumpFolder, segment);
      if (!request_.dumpFolder.empty()) {
        writeFile(request_.dumpFolder + "/" + std::to_string(segment) + ".tsg", job.payload->data(), job.payload->size());
      }
    }
    json.close('}');
  }

  void print() {
    JsonText segments;
    describeHeld(segments);
    JsonText stats;
    describeStats(stats, stream_->stats());
    JsonText failure;
    if (failure_.empty()) {
      failure.null();
    } else {
      failure.text(failure_);
    }
    std::printf("{\"events\":[%s],\"landings\":[%s],\"picks\":[%s],\"segments\":%s,\"stats\":%s,\"stage\":%s,\"failure\":%s}\n",
        events_.str().c_str(), landings_.str().c_str(), picks_.str().c_str(), segments.str().c_str(), stats.str().c_str(),
        staged_ ? staged_->describe().c_str() : "null", failure.str().c_str());
  }

  const LandRequest& request_;
  const Clock::time_point began_ = Clock::now();
  std::unique_ptr<ISceneStream> stream_;
  SceneStream* pumped_ = nullptr;
  SharedSceneFiles files_;
  /// The newest of options and steps.
  std::string token_;
  std::unique_ptr<StagedVisit> staged_;
  JsonText events_;
  JsonText landings_;
  JsonText picks_;
  std::map<std::uint32_t, SegmentFacts> held_;
  std::int64_t landing_ = kNoLanding;
  std::int64_t planned_ = kNoLanding;
  std::int64_t ready_ = kNoLanding;
  int prefetched_ = 0;
  int picked_ = 0;
  // Of groups: who is there, seats had, landings told, barriers that opened.
  std::size_t people_ = 0;
  int joined_ = 0;
  int called_ = 0;
  int gathered_ = 0;
  std::string refusedCode_;
  std::string closedCode_;
  std::string failure_;
};

}  // namespace
}  // namespace terraport::tools

int main(int count, char** arguments) {
  const auto request = terraport::tools::parseLand(count, arguments);
  return request ? terraport::tools::Visit(*request).run() : 2;
}
