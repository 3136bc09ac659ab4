#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "Terraport/SceneRenderer.h"

namespace terraport::tools {

/// A renderer that draws nothing: it notes what would be drawn, and every order that a real one could not keep (a segment shown
/// that was never uploaded, a block of the base changed that was not prepared, ...).
class RecordingRenderer final : public SceneRenderer {
 public:
  UploadState upload(std::uint32_t segment, const SegmentMesh& mesh, ByteSpan payload) override;
  bool isDrawable(std::uint32_t segment) override;
  void free(std::uint32_t segment) override;
  void beginBase(const SceneFiles& files) override;
  void prepareBase(const FaceRange& block, const HiddenFaces& next) override;
  void swap(const SceneSwap& change) override;

  /// Segments that are drawn, ascending.
  const std::set<std::uint32_t>& shown() const { return shown_; }
  /// Base faces that are not drawn, ascending: as the prepared blocks say, not as the stage says.
  std::vector<std::uint32_t> hiddenFaces() const;
  /// Orders that could not be kept.
  const std::vector<std::string>& faults() const { return faults_; }
  int swaps() const { return swaps_; }

 private:
  void fault(const std::string& text) { faults_.push_back(text); }

  /// Uploaded segments, and how often each was asked whether it can be drawn.
  std::map<std::uint32_t, int> uploaded_;
  std::set<std::uint32_t> begun_;
  std::set<std::uint32_t> shown_;
  /// Of the base that is drawn, one entry per face: 1 where it is hidden.
  std::vector<std::uint8_t> drawn_;
  std::map<std::uint32_t, std::vector<std::uint8_t>> prepared_;
  std::vector<std::string> faults_;
  int swaps_ = 0;
};

}  // namespace terraport::tools
