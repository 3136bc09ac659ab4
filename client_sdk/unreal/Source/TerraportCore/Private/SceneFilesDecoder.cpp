// From the bytes of a version's files to SceneFiles: sizes and hashes compared first, then each decoded.
#include <memory>
#include <string>

#include "Manifest.h"
#include "Terraport/CoverFile.h"
#include "Terraport/GlbDecoder.h"
#include "Terraport/SceneLoader.h"
#include "Terraport/Xxh3.h"

namespace terraport {
namespace {

Status expectFile(const SharedPayload& bytes, const FileFacts& facts, const char* name) {
  if (!bytes || bytes->size() != facts.bytes) {
    return Status::damaged(std::string(name) + " has " + std::to_string(bytes ? bytes->size() : 0) + " bytes, expected " +
        std::to_string(facts.bytes) + " by the manifest; load it again");
  }
  if (xxh3Hash64(viewOf(*bytes)) != facts.xxh3) {
    return Status::damaged(std::string(name) + " has another hash than the manifest says; load it again");
  }
  return {};
}

Status decodeAll(const CheckedManifest& checked, const SceneFileBytes& bytes, SceneFiles& files) {
  TERRAPORT_RETURN_IF_ERROR(expectFile(bytes.baseGlb, checked.baseGlb, "base.glb"));
  TERRAPORT_RETURN_IF_ERROR(expectFile(bytes.baseCover, checked.baseCover, "base.cover"));
  TERRAPORT_RETURN_IF_ERROR(expectFile(bytes.regionsJson, checked.regionsJson, "regions.json"));
  files.manifest = checked.manifest;
  GlbDecoder decoder;
  TERRAPORT_RETURN_IF_ERROR(decoder.decode(viewOf(*bytes.baseGlb), files.base));
  files.basePayload = bytes.baseGlb;
  if (files.base.faceCount != checked.manifest.baseFaces) {
    return Status::damaged("base of " + std::to_string(files.base.faceCount) + " faces, expected " +
        std::to_string(checked.manifest.baseFaces) + " by the manifest");
  }
  TERRAPORT_RETURN_IF_ERROR(
      decodeCover(viewOf(*bytes.baseCover), checked.manifest.baseFaces, checked.manifest.segmentCount, files.cover));
  const RegionLabels labels = bytes.labelsJson ? readLabels(viewOf(*bytes.labelsJson)) : RegionLabels();
  return readRegions(viewOf(*bytes.regionsJson), labels, files.regions, files.unions);
}

}  // namespace

Result<std::shared_ptr<SceneFiles>> decodeSceneFiles(
    ByteSpan manifestJson, const std::string& id, const SceneFileBytes& bytes) {
  CheckedManifest checked;
  Status status = readManifest(manifestJson, id, checked);
  if (!status.isOk()) {
    return status;
  }
  auto files = std::make_shared<SceneFiles>();
  status = decodeAll(checked, bytes, *files);
  if (!status.isOk()) {
    return Status::failed(status.code(), "scene " + id + ", version " + checked.manifest.version + ": " + status.text());
  }
  return files;
}

}  // namespace terraport
