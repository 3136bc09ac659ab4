// A scene's JSON, its base, and a user's URL.
#include "Core/Scene.h"
#include "Core/SceneUrl.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace terraport;
  Scene scene;
  if (readManifest({data, size}, scene).isOk()) (void)readBase(std::make_shared<const Bytes>(data, data + size), scene).isOk();
  (void)readRegions({data, size}, {data, size}, scene).isOk();
  SceneUrl url;
  (void)parseSceneUrl(std::string(reinterpret_cast<const char*>(data), size), url).isOk();
  return 0;
}
