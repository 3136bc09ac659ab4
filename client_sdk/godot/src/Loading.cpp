#include "Loading.h"

#include <chrono>
#include <utility>

#include "HttpGets.h"
#include "Terraport/SceneLoader.h"
#include "TerraportBaseOrder.h"

namespace terraport::godot {

Loading::Loading(LoadRequest request) : request_(std::move(request)), thread_([this] { run(); }) {}

Loading::~Loading() {
  isStopping_ = true;
  thread_.join();
}

bool Loading::poll(LoadResult& result) {
  if (!isOver_) return false;
  result = std::move(result_);
  return true;
}

void Loading::run() {
  HttpGets http;
  SceneLoadOptions options;
  options.token = request_.token;
  options.version = request_.version;
  // Unsorted the base is drawn as well, only with more blocks to change; the loader has checked that the cover fits.
  options.afterLoad = [this](SceneFiles& files) { (void)TerraportBaseOrder::Reorder(files, request_.blockFaces); };
  SceneLoader loader(http, request_.url, std::move(options));
  while (!isStopping_ && loader.pump() == LoadState::Loading) std::this_thread::sleep_for(std::chrono::milliseconds(2));
  if (!isStopping_) {
    result_.status = loader.status();
    result_.sceneUrl = loader.sceneUrl();
    result_.files = loader.files();
    if (result_.files) result_.base = makeBaseParts(*result_.files, request_.blockFaces, request_.attribute);
  }
  isOver_ = true;
}

}  // namespace terraport::godot
