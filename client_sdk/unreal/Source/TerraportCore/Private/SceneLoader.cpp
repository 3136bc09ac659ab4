#include "Terraport/SceneLoader.h"

#include <atomic>
#include <utility>

#include "JsonExpect.h"
#include "Manifest.h"
#include "Terraport/SceneUrl.h"

namespace terraport {
namespace {

constexpr std::size_t kMaxManifestBytes = std::size_t{4} << 20;
constexpr std::size_t kMaxListBytes = std::size_t{16} << 20;
constexpr std::size_t kMaxLabelsBytes = std::size_t{64} << 20;
constexpr std::size_t kMaxErrorBytes = 65536;
constexpr std::size_t kMaxErrorText = 1024;

/// Code by HTTP status, where the server gave none.
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

/// What to do, where the server cannot know it.
const char* adviceOn(std::string_view code) {
  if (code == "unauthorised") {
    return "; give a token that the service knows";
  }
  if (code == "forbidden") {
    return "; ask for a token that opens this scene";
  }
  return code == "draining" ? "; try again in a moment" : "";
}

/// The failure that an answer stands for; success where it is a body.
Status statusOf(const std::string& url, const HttpAnswer& answer, std::size_t mostBytes) {
  // An engine may give such an answer up before it is all there, and then have no status to tell.
  if (answer.isTooLarge && (answer.status == 0 || answer.status == 200)) {
    return Status::damaged(url + " has more than " + std::to_string(mostBytes) + " bytes; is this a terraport server?");
  }
  if (answer.status == 0) {
    return Status::failed(
        "unreachable", "no answer from " + url + " (" + answer.reason + "); is the server running, and reachable from here?");
  }
  if (answer.status == 200 && answer.body.size() <= mostBytes) {
    return {};
  }
  if (answer.status == 200) {
    return Status::damaged(url + " has more than " + std::to_string(mostBytes) + " bytes; is this a terraport server?");
  }
  std::string code = codeOf(answer.status);
  std::string message = url + " was refused with HTTP status " + std::to_string(answer.status);
  JsonDocument document;
  JsonLimits limits;
  limits.maxBytes = kMaxErrorBytes;
  if (document.read(textOf(viewOf(answer.body)), limits).isOk()) {
    const JsonValue error = document.root().member("error");
    const std::string_view statedCode = error.member("code").text().value_or("");
    const std::string_view statedMessage = error.member("message").text().value_or("");
    code = statedCode.empty() ? code : std::string(statedCode.substr(0, kMaxErrorText));
    message = statedMessage.empty() ? message : std::string(statedMessage.substr(0, kMaxErrorText));
  }
  return Status::failed(code, message + adviceOn(code));
}

/// The only scene of a server's list.
Status onlyScene(const std::string& server, const std::vector<std::uint8_t>& body, std::string& id) {
  JsonDocument document;
  JsonLimits limits;
  limits.maxBytes = kMaxListBytes;
  const bool isRead = document.read(textOf(viewOf(body)), limits).isOk();
  const JsonValue scenes = isRead ? document.root().member("scenes") : JsonValue();
  if (!scenes.isList()) {
    return Status::damaged(server + "/scenes lists no scenes; is this a terraport server?");
  }
  std::string names;
  for (const JsonValue scene : scenes.items()) {
    id = std::string(scene.member("id").text().value_or(""));
    if (names.size() < kMaxErrorText) {
      names += (names.empty() ? "" : ", ") + id;
    }
  }
  if (scenes.size() != 1 || id.empty()) {
    return Status::failed("several_scenes",
        server + " serves " + std::to_string(scenes.size()) + " scenes (" + (names.empty() ? "none" : names) +
            "), expected one: name it as .../scenes/ID");
  }
  return {};
}

/// One request of the loader.
struct Fetch {
  std::string url;
  std::size_t mostBytes = 0;
  std::uint64_t request = 0;
  HttpAnswer answer;
};

/// The work that may be done on another thread, and what came of it.
struct DecodeWork {
  std::vector<std::uint8_t> manifest;
  std::string id;
  SceneFileBytes bytes;
  std::function<void(SceneFiles&)> afterLoad;
  Status status;
  SharedSceneFiles files;
  std::atomic<bool> isDone{false};

  void run() {
    Result<std::shared_ptr<SceneFiles>> result = decodeSceneFiles(viewOf(manifest), id, bytes);
    if (result.isOk()) {
      if (afterLoad) {
        afterLoad(*result.value());
      }
      files = result.take();
    } else {
      status = result.status();
    }
    isDone.store(true, std::memory_order_release);
  }
};

SharedPayload sharedOf(HttpAnswer& answer) {
  return std::make_shared<const std::vector<std::uint8_t>>(std::move(answer.body));
}

}  // namespace

class SceneLoader::Impl {
 public:
  Impl(Http& http, const std::string& url, SceneLoadOptions options) : http_(http), options_(std::move(options)) {
    const Result<SceneUrl> parsed = parseSceneUrl(url);
    if (!parsed.isOk()) {
      fail(parsed.status());
      return;
    }
    server_ = parsed.value().server;
    id_ = parsed.value().scene;
    if (id_.empty()) {
      step_ = Step::List;
      begin({{server_ + "/scenes", kMaxListBytes}});
    } else {
      beginManifest();
    }
  }

  ~Impl() { cancelAll(); }

  void pump() {
    if (state_ != LoadState::Loading) {
      return;
    }
    if (step_ == Step::Decode) {
      if (work_->isDone.load(std::memory_order_acquire)) {
        finish();
      }
      return;
    }
    for (std::size_t at = 0; at < fetches_.size(); ++at) {
      Fetch& fetch = fetches_[at];
      if (fetch.request == 0 || !http_.poll(fetch.request, fetch.answer)) {
        continue;
      }
      fetch.request = 0;
      // Whatever is wrong with labels, the ground is there without.
      const bool isOptional = step_ == Step::Files && at == kLabels;
      const Status status = statusOf(fetch.url, fetch.answer, fetch.mostBytes);
      if (!status.isOk() && !isOptional) {
        giveUp(status, fetch.answer.status == 404 || status.code() == "damaged");
        return;
      }
      if (!status.isOk()) {
        fetch.answer.body.clear();
      }
    }
    for (const Fetch& fetch : fetches_) {
      if (fetch.request != 0) {
        return;
      }
    }
    advance();
  }

  LoadState state_ = LoadState::Loading;
  Status status_;
  SharedSceneFiles files_;
  std::string sceneUrl_;

  std::uint64_t totalBytes() const { return step_ >= Step::Files ? checked_.totalBytes() : 0; }

  std::uint64_t doneBytes() const {
    if (step_ != Step::Files) {
      return totalBytes();
    }
    std::uint64_t done = 0;
    for (std::size_t at = 0; at < kLabels; ++at) {
      const Fetch& fetch = fetches_[at];
      done += fetch.request != 0 ? http_.receivedBytes(fetch.request) : fetch.answer.body.size();
    }
    return done;
  }

 private:
  enum class Step : std::uint8_t { List, Manifest, Files, Decode };
  static constexpr std::size_t kLabels = 3;

  void begin(const std::vector<std::pair<std::string, std::size_t>>& files) {
    fetches_.clear();
    for (const auto& [url, mostBytes] : files) {
      Fetch fetch;
      fetch.url = url;
      fetch.mostBytes = mostBytes;
      fetch.request = http_.get(url, options_.token, mostBytes);
      fetches_.push_back(std::move(fetch));
    }
  }

  void beginManifest() {
    const Result<std::string> url = sceneUrlOf(server_, id_);
    if (!url.isOk()) {
      fail(url.status());
      return;
    }
    sceneUrl_ = url.value();
    step_ = Step::Manifest;
    begin({{sceneUrl_ + (options_.version.empty() ? "" : "?v=" + options_.version), kMaxManifestBytes}});
  }

  void advance() {
    if (step_ == Step::List) {
      const Status status = onlyScene(server_, fetches_[0].answer.body, id_);
      status.isOk() ? beginManifest() : fail(status);
    } else if (step_ == Step::Manifest) {
      takeManifest();
    } else {
      decode();
    }
  }

  void takeManifest() {
    manifest_ = std::move(fetches_[0].answer.body);
    const Status status = readManifest(viewOf(manifest_), id_, checked_);
    if (!status.isOk()) {
      fail(status);
      return;
    }
    if (isAgain_ && checked_.manifest.version == lastVersion_) {
      fail(firstFailure_);
      return;
    }
    lastVersion_ = checked_.manifest.version;
    step_ = Step::Files;
    const std::string version = "?v=" + lastVersion_;
    begin({{sceneUrl_ + "/base.glb" + version, checked_.baseGlb.bytes},
        {sceneUrl_ + "/base.cover" + version, checked_.baseCover.bytes},
        {sceneUrl_ + "/regions.json" + version, checked_.regionsJson.bytes}, {sceneUrl_ + "/labels.json", kMaxLabelsBytes}});
  }

  void decode() {
    step_ = Step::Decode;
    work_ = std::make_shared<DecodeWork>();
    work_->manifest = manifest_;
    work_->id = id_;
    work_->bytes = {sharedOf(fetches_[0].answer), sharedOf(fetches_[1].answer), sharedOf(fetches_[2].answer),
        sharedOf(fetches_[kLabels].answer)};
    work_->afterLoad = options_.afterLoad;
    fetches_.clear();
    if (options_.runElsewhere) {
      // It owns its share: this loader may be gone before it is done.
      options_.runElsewhere([work = work_] { work->run(); });
      return;
    }
    work_->run();
    finish();
  }

  void finish() {
    const std::shared_ptr<DecodeWork> work = std::move(work_);
    if (!work->status.isOk()) {
      giveUp(work->status, work->status.code() == "damaged");
      return;
    }
    files_ = work->files;
    state_ = LoadState::Done;
  }

  /// Published anew between the manifest and its files (scene format, section 2): start over, once.
  void giveUp(const Status& status, bool mayBeNewer) {
    if (!mayBeNewer || step_ < Step::Files || isAgain_ || !options_.version.empty()) {
      fail(status);
      return;
    }
    cancelAll();
    isAgain_ = true;
    firstFailure_ = status;
    beginManifest();
  }

  void fail(const Status& status) {
    cancelAll();
    status_ = status;
    state_ = LoadState::Failed;
  }

  void cancelAll() {
    for (Fetch& fetch : fetches_) {
      if (fetch.request != 0) {
        http_.cancel(fetch.request);
        fetch.request = 0;
      }
    }
  }

  Http& http_;
  SceneLoadOptions options_;
  Step step_ = Step::List;
  std::string server_;
  std::string id_;
  std::vector<Fetch> fetches_;
  std::vector<std::uint8_t> manifest_;
  CheckedManifest checked_;
  std::shared_ptr<DecodeWork> work_;
  bool isAgain_ = false;
  std::string lastVersion_;
  Status firstFailure_;
};

SceneLoader::SceneLoader(Http& http, const std::string& url, SceneLoadOptions options)
    : impl_(new Impl(http, url, std::move(options))) {}

SceneLoader::~SceneLoader() = default;

LoadState SceneLoader::pump() {
  impl_->pump();
  return impl_->state_;
}

LoadState SceneLoader::state() const {
  return impl_->state_;
}

const Status& SceneLoader::status() const {
  return impl_->status_;
}

const SharedSceneFiles& SceneLoader::files() const {
  return impl_->files_;
}

const std::string& SceneLoader::sceneUrl() const {
  return impl_->sceneUrl_;
}

std::uint64_t SceneLoader::doneBytes() const {
  return impl_->doneBytes();
}

std::uint64_t SceneLoader::totalBytes() const {
  return impl_->totalBytes();
}

}  // namespace terraport
