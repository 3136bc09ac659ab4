#include "Core/SceneLoader.h"

#include <utility>

#include "Core/Value.h"

namespace terraport {
namespace {

constexpr std::size_t kMaxManifestBytes = std::size_t{16} << 20;
constexpr std::size_t kMaxLabelsBytes = std::size_t{64} << 20;
constexpr std::size_t kMaxErrorText = 1024;

/// Code of an HTTP status, where the service gave none.
const char* codeOf(int status) {
  switch (status) {
    case 401:
      return "unauthorised";
    case 403:
      return "forbidden";
    case 404:
      return "unknown_scene";
    case 429:
      return "too_many";
    case 503:
      return "draining";
    default:
      return "refused";
  }
}

/// What to do, where the service cannot know it.
const char* adviceOn(const std::string& code) {
  if (code == "unauthorised") return "; give a token that the service knows";
  if (code == "forbidden") return "; ask for a token that opens this scene";
  return code == "draining" ? "; try again in a moment" : "";
}

/// The failure that an answer stands for; success for a body.
Status statusOf(const std::string& url, const HttpAnswer& answer) {
  if (answer.isTooLarge) return Status::damaged(url + " has more bytes than expected; is this a terraport server?");
  if (answer.status == 0) {
    return Status::failed(
        "unreachable", "no answer from " + url + " (" + answer.reason + "); is the server running, and reachable from here?");
  }
  if (answer.status == 200) return {};
  Value document;
  (void)readJson(answer.body, document).isOk();
  const Value& error = document["error"];
  const std::string code = error["code"].textUpTo(kMaxErrorText).value_or(codeOf(answer.status));
  const std::string message =
      error["message"].textUpTo(kMaxErrorText).value_or(url + " was refused with HTTP status " + std::to_string(answer.status));
  return Status::failed(code, message + adviceOn(code));
}

}  // namespace

struct SceneLoader::Work {
  std::shared_ptr<Scene> scene = std::make_shared<Scene>();
  SharedBytes base, regions, labels;
  std::function<void(Scene&)> afterLoad;
  Status status;
  std::atomic<bool> isDone{false};

  void run() {
    status = readBase(base, *scene);
    if (status.isOk()) status = readRegions(*regions, *labels, *scene);
    if (status.isOk() && afterLoad) afterLoad(*scene);
    isDone.store(true, std::memory_order_release);
  }
};

SceneLoader::SceneLoader(Http& http, Options options) : http_(http), options_(std::move(options)) {
  const Status status = parseSceneUrl(options_.url, url_);
  if (!status.isOk()) {
    fail(status);
  } else if (url_.scene.empty()) {
    begin({{url_.server + "/scenes", kMaxManifestBytes}});
  } else {
    beginManifest();
  }
}

SceneLoader::~SceneLoader() {
  for (const Request& request : requests_) {
    if (request.number != 0) http_.cancel(request.number);
  }
}

SceneLoader::State SceneLoader::pump() {
  if (state_ != State::Loading) return state_;
  if (work_) {
    if (!work_->isDone.load(std::memory_order_acquire)) return state_;
    if (!work_->status.isOk()) {
      fail(work_->status);
    } else {
      scene_ = work_->scene;
      state_ = State::Done;
    }
    return state_;
  }
  bool isOver = true;
  for (Request& request : requests_) {
    if (request.number != 0 && http_.poll(request.number, request.answer)) {
      request.number = 0;
      const Status status = statusOf(request.url, request.answer);
      if (!status.isOk()) {
        fail(status);
        return state_;
      }
    }
    isOver = isOver && request.number == 0;
  }
  if (isOver) advance();
  return state_;
}

void SceneLoader::begin(std::vector<std::pair<std::string, std::size_t>> files) {
  requests_.clear();
  for (auto& [url, maxBytes] : files) {
    const std::uint64_t number = http_.get(url, options_.token, maxBytes);
    requests_.push_back({std::move(url), maxBytes, number, {}});
  }
}

void SceneLoader::beginManifest() {
  step_ = Step::Manifest;
  begin({{url_.http() + (options_.version.empty() ? "" : "?v=" + options_.version), kMaxManifestBytes}});
}

void SceneLoader::advance() {
  if (step_ == Step::List) {
    Value document;
    (void)readJson(requests_[0].answer.body, document).isOk();
    const std::vector<Value>& scenes = document["scenes"].items;
    if (scenes.size() != 1) {
      return fail(Status::failed("several_scenes",
          url_.server + " serves " + std::to_string(scenes.size()) + " scenes, expected one: name it as .../scenes/ID"));
    }
    url_.scene = percentEncoded(scenes[0]["id"].text);
    beginManifest();
  } else if (step_ == Step::Manifest) {
    auto work = std::make_shared<Work>();
    const Status status = readManifest(requests_[0].answer.body, *work->scene);
    if (!status.isOk()) return fail(status);
    step_ = Step::Files;
    const Scene& scene = *work->scene;
    const std::string version = "?v=" + scene.version;
    begin({{url_.http() + "/base.tsg" + version, scene.baseBytes},
        {url_.http() + "/regions.json" + version, scene.regionsBytes}, {url_.http() + "/labels.json", kMaxLabelsBytes}});
    pending_ = std::move(work);
  } else {
    const auto take = [this](std::size_t at) { return std::make_shared<const Bytes>(std::move(requests_[at].answer.body)); };
    work_ = std::move(pending_);
    work_->base = take(0);
    work_->regions = take(1);
    work_->labels = take(2);
    work_->afterLoad = options_.afterLoad;
    options_.runElsewhere([work = work_] { work->run(); });
  }
}

void SceneLoader::fail(Status status) {
  status_ = std::move(status);
  state_ = State::Failed;
}

}  // namespace terraport
