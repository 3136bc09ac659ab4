#include "recording_renderer.h"

#include <algorithm>

namespace terraport::tools {

UploadState RecordingRenderer::upload(std::uint32_t segment, const SegmentMesh& mesh, ByteSpan payload) {
  if (mesh.vertexCount == 0 || mesh.faceCount == 0 || payload.size == 0) {
    fault("upload of an empty segment " + std::to_string(segment));
  }
  if (uploaded_.count(segment) != 0) {
    fault("second upload of segment " + std::to_string(segment));
  }
  // Every other segment in two slices, as one with an image.
  if (segment % 2 == 1 && begun_.insert(segment).second) {
    return UploadState::More;
  }
  begun_.erase(segment);
  uploaded_[segment] = 0;
  return UploadState::Done;
}

bool RecordingRenderer::isDrawable(std::uint32_t segment) {
  const auto entry = uploaded_.find(segment);
  if (entry == uploaded_.end()) {
    fault("segment " + std::to_string(segment) + " is asked about and was not uploaded");
    return false;
  }
  return ++entry->second > 1;
}

void RecordingRenderer::free(std::uint32_t segment) {
  begun_.erase(segment);
  uploaded_.erase(segment);
  shown_.erase(segment);
}

void RecordingRenderer::beginBase(const SceneFiles& files) {
  drawn_.assign(files.base.faceCount, 0);
  prepared_.clear();
  shown_.clear();
}

void RecordingRenderer::prepareBase(const FaceRange& block, const HiddenFaces& next) {
  if (next.faceCount != drawn_.size() || block.first + block.count > drawn_.size()) {
    fault("a block beyond the base's faces");
    return;
  }
  prepared_[block.first].assign(next.faces + block.first, next.faces + block.first + block.count);
}

void RecordingRenderer::swap(const SceneSwap& change) {
  ++swaps_;
  for (const std::uint32_t segment : change.shown) {
    const auto entry = uploaded_.find(segment);
    if (entry == uploaded_.end() || entry->second < 2) {
      fault("segment " + std::to_string(segment) + " is shown and cannot be drawn");
    }
    if (!shown_.insert(segment).second) {
      fault("segment " + std::to_string(segment) + " is shown twice");
    }
  }
  for (const std::uint32_t segment : change.hidden) {
    if (shown_.erase(segment) == 0) {
      fault("segment " + std::to_string(segment) + " is hidden and was not shown");
    }
  }
  for (const FaceRange& block : change.baseBlocks) {
    const auto entry = prepared_.find(block.first);
    if (entry == prepared_.end() || entry->second.size() != block.count) {
      fault("block " + std::to_string(block.first) + " of the base was not prepared");
      continue;
    }
    std::copy(entry->second.begin(), entry->second.end(), drawn_.begin() + block.first);
  }
  if (!std::equal(drawn_.begin(), drawn_.end(), change.baseHidden.faces)) {
    fault("the prepared blocks of the base are not what the swap says");
  }
}

std::vector<std::uint32_t> RecordingRenderer::hiddenFaces() const {
  std::vector<std::uint32_t> faces;
  for (std::uint32_t face = 0; face < drawn_.size(); ++face) {
    if (drawn_[face] != 0) {
      faces.push_back(face);
    }
  }
  return faces;
}

}  // namespace terraport::tools
