#include <doctest/doctest.h>

#include <map>

#include "Manifest.h"
#include "Terraport/SceneLoader.h"
#include "test_files.h"

using namespace terraport;
using namespace terraport_tests;

namespace {

/// Answers from a folder of the corpus, some polls later.
class FakeHttp final : public Http {
 public:
  std::uint64_t get(const std::string& url, const std::string& bearerToken, std::size_t maxBytes) override {
    urls.push_back(url);
    tokens.push_back(bearerToken);
    Waiting waiting;
    waiting.answer = answerTo(url);
    waiting.answer.isTooLarge = waiting.answer.body.size() > maxBytes;
    waiting_[++last_] = std::move(waiting);
    return last_;
  }

  bool poll(std::uint64_t request, HttpAnswer& answer) override {
    const auto pending = waiting_.find(request);
    REQUIRE(pending != waiting_.end());
    if (--pending->second.polls > 0) {
      return false;
    }
    answer = std::move(pending->second.answer);
    waiting_.erase(pending);
    return true;
  }

  std::uint64_t receivedBytes(std::uint64_t request) const override { return waiting_.at(request).answer.body.size() / 2; }

  void cancel(std::uint64_t request) override { CHECK(waiting_.erase(request) == 1); }

  std::size_t open() const { return waiting_.size(); }

  void put(const std::string& path, const std::string& body) { bodies[path] = {body.begin(), body.end()}; }

  std::map<std::string, std::vector<std::uint8_t>> bodies;
  std::map<std::string, int> refused;
  std::vector<std::string> urls;
  std::vector<std::string> tokens;
  std::function<void(const std::string&)> onAsk;

 private:
  struct Waiting {
    HttpAnswer answer;
    int polls = 3;
  };

  HttpAnswer answerTo(const std::string& url) {
    const std::string path = url.substr(std::string("http://host:8000").size());
    if (onAsk) {
      onAsk(path);
    }
    const std::string bare = path.substr(0, path.find('?'));
    HttpAnswer answer;
    if (refused.count(bare) != 0) {
      answer.status = refused[bare];
      answer.reason = "connection refused";
      return answer;
    }
    const auto body = bodies.find(bare);
    answer.status = body == bodies.end() ? 404 : 200;
    if (body != bodies.end()) {
      answer.body = body->second;
    } else {
      const std::string error = R"({"error":{"code":"unknown_scene","message":"no such scene here"}})";
      answer.body.assign(error.begin(), error.end());
    }
    return answer;
  }

  std::map<std::uint64_t, Waiting> waiting_;
  std::uint64_t last_ = 0;
};

void addScene(FakeHttp& http, const std::string& folder, const std::string& id) {
  const std::filesystem::path scene = conformance() / "scene" / folder;
  const std::string text = readText(scene / "scene.json");
  JsonDocument document;
  REQUIRE(document.read(text).isOk());
  const std::string at = "/scenes/" + id;
  http.put(at, text);
  for (const char* key : {"base.glb", "base.cover", "regions.json"}) {
    const auto path = document.root().member("files").member(key).member("path").text();
    REQUIRE(path);
    http.bodies[at + "/" + key] = readFile(scene / std::string(*path));
  }
  if (std::filesystem::exists(scene / "labels.json")) {
    http.put(at + "/labels.json", readText(scene / "labels.json"));
  }
}

LoadState pumped(SceneLoader& loader) {
  for (int turn = 0; turn < 100 && loader.pump() == LoadState::Loading; ++turn) {
  }
  return loader.state();
}

std::string manifestText(const std::string& folder = "tiny") {
  return readText(conformance() / "scene" / folder / "scene.json");
}

Status readManifestText(const std::string& text) {
  CheckedManifest checked;
  return readManifest({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}, "tiny", checked);
}

std::string replaced(std::string text, const std::string& pattern, const std::string& replacement) {
  const std::size_t at = text.find(pattern);
  REQUIRE(at != std::string::npos);
  return text.replace(at, pattern.size(), replacement);
}

}  // namespace

TEST_SUITE("scene loader") {
  TEST_CASE("every scene of the corpus is loaded, with its labels") {
    for (const char* folder : {"tiny", "tiny-textured", "tiny-base-image", "tiny-changed", "axes"}) {
      CAPTURE(folder);
      FakeHttp http;
      addScene(http, folder, "one");
      SceneLoadOptions options;
      options.token = "secret";
      int loaded = 0;
      options.afterLoad = [&](SceneFiles& files) { loaded += files.base.faceCount > 0 ? 1 : 0; };
      SceneLoader loader(http, "ws://host:8000/scenes/one/stream", options);
      REQUIRE_MESSAGE(pumped(loader) == LoadState::Done, loader.status().text());
      CHECK(loaded == 1);
      CHECK(loader.sceneUrl() == "http://host:8000/scenes/one");
      const SceneFiles& files = *loader.files();
      CHECK(files.manifest.id == "one");
      CHECK(files.base.segment == -1);
      CHECK(files.base.faceCount == files.manifest.baseFaces);
      CHECK(files.cover.faceCount() == files.manifest.baseFaces);
      CHECK_FALSE(files.regions.empty());
      CHECK(loader.doneBytes() == loader.totalBytes());
      CHECK(loader.totalBytes() > 1000);
      const std::string name = folder;
      const bool isPlain = name == "tiny" || name == "tiny-changed";
      CHECK(files.manifest.hasTextures == !isPlain);
      // Each payload says itself what it has: an image in the base alone leaves segments their colours.
      CHECK((files.base.image.bytes > 0) == (!isPlain && name != "axes"));
      CHECK(files.manifest.hasColour == (isPlain || name == "tiny-base-image"));
      CHECK(http.tokens.back() == "secret");
      CHECK(http.open() == 0);
      // There and back, and the origin is the origin.
      const Vec3 survey = toSurvey(files.manifest, {1.0, 2.0, 3.0});
      CHECK(survey.y == files.manifest.origin[1] - 3.0);
      const Vec3 back = fromSurvey(files.manifest, survey);
      CHECK((back.x == 1.0 && back.y == 2.0 && back.z == 3.0));
    }
  }

  TEST_CASE("labels stand before the build's own names") {
    FakeHttp http;
    addScene(http, "tiny", "one");
    SceneLoader loader(http, "http://host:8000/scenes/one");
    REQUIRE(pumped(loader) == LoadState::Done);
    bool isLabelled = false;
    for (const RegionFacts& region : loader.files()->regions) {
      isLabelled = isLabelled || region.label.has_value();
      CHECK(region.stableId.has_value());
    }
    CHECK(isLabelled);
    // Damaged ones are none, and take nothing away.
    http.put("/scenes/one/labels.json", "{\"format\": 7");
    SceneLoader again(http, "http://host:8000/scenes/one");
    CHECK(pumped(again) == LoadState::Done);
  }

  TEST_CASE("a server's only scene; several are asked back") {
    FakeHttp http;
    addScene(http, "tiny", "one");
    http.put("/scenes", R"({"scenes":[{"id":"one","name":"One"}]})");
    SceneLoader loader(http, "http://host:8000");
    REQUIRE_MESSAGE(pumped(loader) == LoadState::Done, loader.status().text());
    http.put("/scenes", R"({"scenes":[{"id":"one"},{"id":"two"}]})");
    SceneLoader several(http, "http://host:8000/");
    CHECK(pumped(several) == LoadState::Failed);
    CHECK(several.status().code() == "several_scenes");
    CHECK(several.status().message().find("one, two") != std::string::npos);
    http.put("/scenes", "<html>");
    SceneLoader other(http, "http://host:8000/");
    CHECK(pumped(other) == LoadState::Failed);
    CHECK(other.status().code() == "damaged");
  }

  TEST_CASE("what cannot be had is said") {
    FakeHttp http;
    addScene(http, "tiny", "one");
    const auto codeFor = [&](const std::string& url) {
      SceneLoader loader(http, url);
      CHECK(pumped(loader) == LoadState::Failed);
      CHECK(http.open() == 0);
      return loader.status().code();
    };
    CHECK(codeFor("http://host:8000/scenes/none") == "unknown_scene");
    CHECK(codeFor("ftp://host/scenes/one") == "invalid_url");
    http.refused["/scenes/one/base.cover"] = 0;
    CHECK(codeFor("http://host:8000/scenes/one") == "unreachable");
    http.refused["/scenes/one/base.cover"] = 401;
    CHECK(codeFor("http://host:8000/scenes/one") == "unauthorised");
    http.refused.clear();
    http.bodies["/scenes/one/base.glb"][100] ^= 1;
    CHECK(codeFor("http://host:8000/scenes/one") == "damaged");
    http.bodies["/scenes/one/base.glb"].pop_back();
    CHECK(codeFor("http://host:8000/scenes/one") == "damaged");
    http.bodies["/scenes/one/base.glb"].resize(1 << 20);
    CHECK(codeFor("http://host:8000/scenes/one") == "damaged");
  }

  TEST_CASE("published anew meanwhile: it begins again, once") {
    FakeHttp http;
    addScene(http, "tiny", "one");
    int manifests = 0;
    http.onAsk = [&](const std::string& path) {
      manifests += path == "/scenes/one" ? 1 : 0;
      if (path.find("/base.cover") != std::string::npos && manifests == 1) {
        addScene(http, "tiny-textured", "one");  // regions.json and all that follows are the new version's
        http.bodies.erase("/scenes/one/base.cover");
      } else if (manifests == 2) {
        addScene(http, "tiny-textured", "one");
      }
    };
    SceneLoader loader(http, "http://host:8000/scenes/one");
    REQUIRE_MESSAGE(pumped(loader) == LoadState::Done, loader.status().text());
    CHECK(loader.files()->manifest.hasTextures);
    CHECK(manifests == 2);
  }

  TEST_CASE("decoding elsewhere; a loader that is gone before leaves nothing behind") {
    FakeHttp http;
    addScene(http, "tiny", "one");
    std::vector<std::function<void()>> work;
    SceneLoadOptions options;
    options.runElsewhere = [&](std::function<void()> task) { work.push_back(std::move(task)); };
    auto loader = std::make_unique<SceneLoader>(http, "http://host:8000/scenes/one", options);
    CHECK(pumped(*loader) == LoadState::Loading);
    REQUIRE(work.size() == 1);
    work[0]();
    CHECK(loader->pump() == LoadState::Done);
    loader = std::make_unique<SceneLoader>(http, "http://host:8000/scenes/one", options);
    CHECK(pumped(*loader) == LoadState::Loading);
    loader.reset();
    work[1]();
    loader = std::make_unique<SceneLoader>(http, "http://host:8000/scenes/one", options);
    loader->pump();
    loader.reset();
    CHECK(http.open() == 0);
  }

  TEST_CASE("a manifest is checked for all that is used of it") {
    const std::string whole = manifestText();
    CHECK(readManifestText(whole).isOk());
    CHECK(readManifestText(replaced(whole, "\"terraport-scene\"", "\"other\"")).code() == "damaged");
    CHECK(readManifestText(replaced(whole, "\"format_version\"", "\"no_version\"")).code() == "unsupported_version");
    for (const char* key : {"\"counts\"", "\"files\"", "\"encodings\"", "\"origin\"", "\"step_m\"", "\"bounds\"",
             "\"hand_off\"", "\"base.cover\"", "\"has_colour\"", "\"attributes\"", "\"version\"", "\"name\"", "\"crs\""}) {
      CAPTURE(key);
      CHECK(readManifestText(replaced(whole, key, "\"renamed\"")).code() == "damaged");
    }
    for (const char* levels : {"0", "3", "-1", "\"2\""}) {
      CHECK(readManifestText(replaced(whole, "\"counts\"", "\"levels\": " + std::string(levels) + ", \"counts\"")).code() ==
          "damaged");
    }
    CHECK(readManifestText(replaced(whole, "\"counts\"", "\"levels\": 2, \"counts\"")).isOk());
    CHECK_FALSE(readManifestText("").isOk());
    CHECK_FALSE(readManifestText("[]").isOk());
  }
}
