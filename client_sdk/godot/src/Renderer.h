// Draws what the stage orders, by the engine's VisualServer: one mesh and one instance for each segment and block of the base.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <unordered_map>
#include <vector>

#include "Collider.h"
#include "Godot.h"
#include "GroundMesh.h"
#include "MeshArrays.h"
#include "Terraport/SceneRenderer.h"

namespace terraport::godot {

/// Where and with what the ground is drawn: what a node of the engine has.
struct DrawSettings {
  /// RID of the world's scenario; of the shader.
  Variant scenario;
  Variant shader;
  /// The node's place in the world.
  Variant transform;
  bool isVisible = true;
  bool castsShadows = false;
  /// Of the engine's render layers, a bit each.
  std::int64_t layers = 1;
};

/// Main thread. Nothing is drawn or hidden but in `swap` and when a base has become whole.
class Renderer final : public SceneRenderer {
 public:
  Renderer(const DrawSettings& settings, Collider& collider);
  ~Renderer() override;
  Renderer(const Renderer&) = delete;
  Renderer& operator=(const Renderer&) = delete;

  /// The base that the next `beginBase` is of.
  void setBase(std::shared_ptr<const BaseParts> base) { base_ = std::move(base); }
  /// Make one block of a new base; false where there is none to make.
  bool step();

  void setTransform(const Variant& transform);
  void setVisible(bool isVisible);
  /// Of every material, now and later.
  void setParameter(const std::string& name, const Variant& value);

  /// First point of what is shown along a ray, scene frame, and its segment (-1: the base).
  bool cast(const Vec3& origin, const Vec3& direction, double maxAt, GroundPoint& point, std::int64_t& segment) const;

  /// Meshes that the engine keeps for us: segments, blocks and what is still to be given back.
  std::size_t meshCount() const { return meshes_; }

  UploadState upload(std::uint32_t segment, const SegmentMesh& mesh, ByteSpan payload) override;
  void free(std::uint32_t segment) override;
  std::size_t gpuBytesOf(const SegmentMesh& mesh) const override;
  void beginBase(const SceneFiles& files) override;
  void prepareBase(const FaceRange& block, const HiddenFaces& next) override;
  bool isBaseReady() override { return isBaseShown_; }
  void swap(const SceneSwap& change) override;

 private:
  struct Drawable {
    /// RIDs; nil where there is none.
    Variant mesh;
    Variant instance;
    Variant material;
    Variant texture;
    std::shared_ptr<const GroundMesh> ground;
    bool isShown = false;
  };
  struct Block {
    Drawable front;
    Drawable back;
    bool hasBack = false;
  };

  Drawable make(const VertexArrays& vertices, const Variant& indices, const Variant& material);
  Variant makeMaterial(const Variant& texture);
  Variant makeTexture(const Variant& image);
  void makeBlock(std::size_t number, const HiddenFaces* hidden, Drawable& drawable);
  void show(Drawable& drawable, bool isShown, std::int64_t source);
  void release(Drawable& drawable, std::int64_t source);
  void releaseBase();
  /// Of an earlier version: drawn until the new base is whole, if it is drawn.
  void leave(Drawable& drawable, std::int64_t source);
  void releaseLeaving();
  template <typename Visit>
  void visitAll(Visit&& take);

  DrawSettings settings_;
  Collider& collider_;
  std::map<std::string, Variant> parameters_;
  std::unordered_map<std::uint32_t, Drawable> segments_;
  /// Ids from here on are those of the coarser level: rays and colours are the segment's, at either.
  std::uint32_t segmentCount_ = 1;
  std::shared_ptr<const BaseParts> base_;
  std::vector<Block> blocks_;
  std::vector<Drawable> leaving_;
  Variant baseMaterial_;
  Variant baseTexture_;
  double deviationM_ = 0.0;
  std::size_t nextBlock_ = 0;
  bool isBaseShown_ = false;
  std::size_t meshes_ = 0;
};

}  // namespace terraport::godot
