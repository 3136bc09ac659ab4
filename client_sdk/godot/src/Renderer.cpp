#include "Renderer.h"

#include <algorithm>
#include <utility>

namespace terraport::godot {

namespace {

Method kMeshCreate{"VisualServer", "mesh_create"};
Method kAddSurface{"VisualServer", "mesh_add_surface_from_arrays"};
Method kSetMaterial{"VisualServer", "mesh_surface_set_material"};
Method kInstanceCreate{"VisualServer", "instance_create2"};
Method kInstanceVisible{"VisualServer", "instance_set_visible"};
Method kInstanceTransform{"VisualServer", "instance_set_transform"};
Method kInstanceLayers{"VisualServer", "instance_set_layer_mask"};
Method kInstanceShadows{"VisualServer", "instance_geometry_set_cast_shadows_setting"};
Method kMaterialCreate{"VisualServer", "material_create"};
Method kMaterialShader{"VisualServer", "material_set_shader"};
Method kMaterialParameter{"VisualServer", "material_set_param"};
Method kTextureOfImage{"VisualServer", "texture_create_from_image"};
Method kFree{"VisualServer", "free_rid"};

constexpr int kTriangles = 4;  // VisualServer.PRIMITIVE_TRIANGLES
// VisualServer.ARRAY_COMPRESS_NORMAL | ARRAY_COMPRESS_COLOR: bytes, which is what the payload has. Texture coordinates and
// facts stay floats: halves are half a texel off in an image of 2048.
constexpr int kCompress = 1024 | 4096;
constexpr int kTextureFlags = 1 | 4;  // VisualServer.TEXTURE_FLAG_MIPMAPS | TEXTURE_FLAG_FILTER
constexpr std::size_t kVertexBytes = 12 + 4 + 4 + 8;

abi::Object* server() {
  static abi::Object* const visual = singleton("VisualServer");
  return visual;
}

std::int64_t sourceOfBlock(std::size_t number) {
  return -1 - static_cast<std::int64_t>(number);
}

}  // namespace

Renderer::Renderer(const DrawSettings& settings, Collider& collider) : settings_(settings), collider_(collider) {}

Renderer::~Renderer() {
  for (auto& [segment, drawable] : segments_) release(drawable, segment);
  releaseBase();
  releaseLeaving();
}

bool Renderer::step() {
  if (!base_ || nextBlock_ >= blocks_.size()) return false;
  makeBlock(nextBlock_, nullptr, blocks_[nextBlock_].front);
  ++nextBlock_;
  if (nextBlock_ == blocks_.size()) {
    for (std::size_t number = 0; number < blocks_.size(); ++number) {
      show(blocks_[number].front, true, sourceOfBlock(number));
    }
    isBaseShown_ = true;
    releaseLeaving();
  }
  return true;
}

template <typename Visit>
void Renderer::visitAll(Visit&& take) {
  for (auto& entry : segments_) take(entry.second);
  for (Block& block : blocks_) {
    take(block.front);
    take(block.back);
  }
}

void Renderer::setTransform(const Variant& transform) {
  settings_.transform = transform;
  visitAll([&](Drawable& drawable) {
    if (!drawable.instance.isNil()) (void)kInstanceTransform(server(), drawable.instance, transform);
  });
}

void Renderer::setVisible(bool isVisible) {
  settings_.isVisible = isVisible;
  visitAll([&](Drawable& drawable) {
    if (!drawable.instance.isNil()) (void)kInstanceVisible(server(), drawable.instance, isVisible && drawable.isShown);
  });
}

void Renderer::setParameter(const std::string& name, const Variant& value) {
  parameters_[name] = value;
  visitAll([&](Drawable& drawable) {
    if (!drawable.material.isNil()) (void)kMaterialParameter(server(), drawable.material, name, value);
  });
  if (!baseMaterial_.isNil()) (void)kMaterialParameter(server(), baseMaterial_, name, value);
}

bool Renderer::cast(const Vec3& origin, const Vec3& direction, double maxAt, GroundPoint& point, std::int64_t& segment) const {
  bool isHit = false;
  const auto meet = [&](const Drawable& drawable, std::int64_t source) {
    if (drawable.isShown && drawable.ground && drawable.ground->cast(origin, direction, maxAt, point)) {
      maxAt = point.at;
      segment = source;
      isHit = true;
    }
  };
  for (const auto& [id, drawable] : segments_) meet(drawable, id % segmentCount_);
  for (const Block& block : blocks_) meet(block.front, -1);
  return isHit;
}

UploadState Renderer::upload(std::uint32_t segment, const SegmentMesh& mesh, ByteSpan) {
  auto* data = static_cast<SegmentData*>(mesh.engineData.get());
  if (data == nullptr || data->indices.isNil()) return UploadState::Failed;
  Drawable& drawable = segments_[segment];
  if (!data->image.isNil()) {
    // A slice of its own: a megapixel takes the driver about as long as a mesh.
    drawable.texture = makeTexture(data->image);
    data->image = Variant();
    return UploadState::More;
  }
  const Variant texture = drawable.texture;
  const Variant material = makeMaterial(texture);
  (void)kMaterialParameter(server(), material, "has_tint", !data->vertices.colours.isNil());
  (void)kMaterialParameter(server(), material, "segment", static_cast<double>(segment % segmentCount_));
  drawable = make(data->vertices, data->indices, material);
  drawable.texture = texture;
  drawable.material = material;
  drawable.ground = std::make_shared<const GroundMesh>(std::move(data->ground));
  data->clear();
  return UploadState::Done;
}

void Renderer::free(std::uint32_t segment) {
  const auto entry = segments_.find(segment);
  if (entry == segments_.end()) return;
  release(entry->second, segment);
  segments_.erase(entry);
}

std::size_t Renderer::gpuBytesOf(const SegmentMesh& mesh) const {
  const std::size_t indexBytes = mesh.maxIndex < 65536 ? 2 : 4;
  return mesh.vertexCount * (kVertexBytes + (mesh.hasUvs ? 8 : 0)) + mesh.indices.size() * indexBytes + mesh.image.gpuBytes();
}

void Renderer::beginBase(const SceneFiles& files) {
  // What is drawn of an earlier version stays until the new base is whole.
  for (auto& [segment, drawable] : segments_) leave(drawable, segment);
  segments_.clear();
  for (std::size_t number = 0; number < blocks_.size(); ++number) leave(blocks_[number].front, sourceOfBlock(number));
  Drawable look;
  look.material = std::exchange(baseMaterial_, Variant());
  look.texture = std::exchange(baseTexture_, Variant());
  leaving_.push_back(std::move(look));
  releaseBase();
  deviationM_ = files.manifest.deviationM;
  segmentCount_ = std::max<std::uint32_t>(files.manifest.segmentCount, 1);
  if (!base_) return;
  blocks_.resize(base_->blocks.size());
  if (!base_->image.isNil()) baseTexture_ = makeTexture(base_->image);
  baseMaterial_ = makeMaterial(baseTexture_);
  (void)kMaterialParameter(server(), baseMaterial_, "has_tint", files.base.hasColours);
  (void)kMaterialParameter(server(), baseMaterial_, "map_of_points", base_->isOfPoints);
  (void)kMaterialParameter(server(), baseMaterial_, "push_m", deviationM_);
  (void)kMaterialParameter(server(), baseMaterial_, "segment", -1.0);
  isBaseShown_ = blocks_.empty();
  if (isBaseShown_) releaseLeaving();
}

void Renderer::prepareBase(const FaceRange& range, const HiddenFaces& next) {
  const std::size_t number = base_ ? range.first / base_->blockFaces : blocks_.size();
  if (number >= blocks_.size()) return;
  Block& block = blocks_[number];
  release(block.back, sourceOfBlock(number));
  makeBlock(number, &next, block.back);
  block.hasBack = true;
}

void Renderer::swap(const SceneSwap& change) {
  for (const std::uint32_t segment : change.hidden) {
    const auto entry = segments_.find(segment);
    if (entry != segments_.end()) show(entry->second, false, segment);
  }
  for (const std::uint32_t segment : change.shown) {
    const auto entry = segments_.find(segment);
    if (entry != segments_.end()) show(entry->second, true, segment);
  }
  for (const FaceRange& range : change.baseBlocks) {
    const std::size_t number = range.first / base_->blockFaces;
    if (number >= blocks_.size() || !blocks_[number].hasBack) continue;
    Block& block = blocks_[number];
    Drawable earlier = std::exchange(block.front, std::exchange(block.back, Drawable()));
    block.hasBack = false;
    release(earlier, sourceOfBlock(number));
    show(block.front, true, sourceOfBlock(number));
  }
}

Renderer::Drawable Renderer::make(const VertexArrays& vertices, const Variant& indices, const Variant& material) {
  Drawable drawable;
  drawable.mesh = kMeshCreate(server());
  (void)kAddSurface(server(), drawable.mesh, kTriangles, surfaceArrays(vertices, indices), List().variant(), kCompress);
  (void)kSetMaterial(server(), drawable.mesh, 0, material);
  drawable.instance = kInstanceCreate(server(), drawable.mesh, settings_.scenario);
  (void)kInstanceVisible(server(), drawable.instance, false);
  (void)kInstanceTransform(server(), drawable.instance, settings_.transform);
  (void)kInstanceLayers(server(), drawable.instance, settings_.layers);
  (void)kInstanceShadows(server(), drawable.instance, settings_.castsShadows ? 1 : 0);
  ++meshes_;
  return drawable;
}

Variant Renderer::makeMaterial(const Variant& texture) {
  Variant material = kMaterialCreate(server());
  (void)kMaterialShader(server(), material, settings_.shader);
  for (const auto& [name, value] : parameters_) (void)kMaterialParameter(server(), material, name, value);
  (void)kMaterialParameter(server(), material, "has_map", !texture.isNil());
  if (!texture.isNil()) (void)kMaterialParameter(server(), material, "map", texture);
  return material;
}

Variant Renderer::makeTexture(const Variant& image) {
  return kTextureOfImage(server(), image, kTextureFlags);
}

void Renderer::makeBlock(std::size_t number, const HiddenFaces* hidden, Drawable& drawable) {
  const BaseBlock& block = base_->blocks[number];
  const std::uint8_t* isHidden = hidden != nullptr ? hidden->faces + number * base_->blockFaces : nullptr;
  const Variant indices = indexArray(block.corners, isHidden);
  if (indices.isNil()) return;  // nothing of it is drawn
  drawable = make(block.vertices, indices, baseMaterial_);
  std::vector<std::uint32_t> corners;
  corners.reserve(block.corners.size());
  for (std::size_t face = 0; face < block.corners.size() / 3; ++face) {
    if (isHidden != nullptr && isHidden[face] != 0) continue;
    corners.insert(corners.end(), &block.corners[3 * face], &block.corners[3 * face] + 3);
  }
  drawable.ground = std::make_shared<const GroundMesh>(block.positions, std::move(corners));
}

void Renderer::show(Drawable& drawable, bool isShown, std::int64_t source) {
  if (drawable.instance.isNil() || drawable.isShown == isShown) return;
  drawable.isShown = isShown;
  (void)kInstanceVisible(server(), drawable.instance, isShown && settings_.isVisible);
  if (isShown) {
    collider_.show(source, drawable.ground);
  } else {
    collider_.hide(source);
  }
}

void Renderer::release(Drawable& drawable, std::int64_t source) {
  if (drawable.isShown) show(drawable, false, source);
  if (!drawable.instance.isNil()) {
    (void)kFree(server(), drawable.instance);
    (void)kFree(server(), drawable.mesh);
    --meshes_;
  }
  if (!drawable.material.isNil()) (void)kFree(server(), drawable.material);
  if (!drawable.texture.isNil()) (void)kFree(server(), drawable.texture);
  drawable = Drawable();
}

void Renderer::leave(Drawable& drawable, std::int64_t source) {
  if (!drawable.isShown) return release(drawable, source);
  collider_.hide(source);
  drawable.isShown = false;
  leaving_.push_back(std::exchange(drawable, Drawable()));
}

void Renderer::releaseLeaving() {
  for (Drawable& drawable : leaving_) release(drawable, 0);
  leaving_.clear();
}

void Renderer::releaseBase() {
  for (std::size_t number = 0; number < blocks_.size(); ++number) {
    release(blocks_[number].back, sourceOfBlock(number));
    release(blocks_[number].front, sourceOfBlock(number));
  }
  blocks_.clear();
  nextBlock_ = 0;
  isBaseShown_ = false;
  if (!baseMaterial_.isNil()) (void)kFree(server(), baseMaterial_);
  if (!baseTexture_.isNil()) (void)kFree(server(), baseTexture_);
  baseMaterial_ = baseTexture_ = Variant();
}

}  // namespace terraport::godot
