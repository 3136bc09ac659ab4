#pragma once

#include "CoreMinimal.h"
#include "Misc/EngineVersionComparison.h"

#include <utility>
#include <vector>

// The render thread and its resources. Commands are carried out at once; what is on the "graphics" is counted.

namespace ERHIFeatureLevel {
enum Type { ES3_1, SM5 };
} // namespace ERHIFeatureLevel
inline ERHIFeatureLevel::Type GMaxRHIFeatureLevel = ERHIFeatureLevel::SM5;
enum EShaderPlatform { SP_NumPlatforms };

class FRHICommandListBase {};
class FRHICommandListImmediate : public FRHICommandListBase {};

/// As the engine's macro is used: a name, and then the command in parentheses.
struct FStubRenderCommand {
  template <typename Command>
  void operator()(Command&& Do) const {
    FRHICommandListImmediate List;
    Do(List);
  }
};
#define ENQUEUE_RENDER_COMMAND(Name) FStubRenderCommand()

class FRenderResource {
 public:
  virtual ~FRenderResource() = default;
  void InitResource(FRHICommandListBase&) { StubInit(); }
  void ReleaseResource() {
    StubGpuBytes -= StubOwnBytes;
    StubOwnBytes = 0;
  }
  /// Of all resources there are.
  static inline int64 StubGpuBytes = 0;

 protected:
  virtual int64 StubUpload() { return 0; }

 private:
  void StubInit() {
    StubOwnBytes = StubUpload();
    StubGpuBytes += StubOwnBytes;
  }
  int64 StubOwnBytes = 0;
};

/// Bytes in main memory until they are uploaded, unless they are to stay.
class FStubBuffer : public FRenderResource {
 public:
  std::vector<uint8> StubMain;

 protected:
  void StubResize(std::size_t Count, bool bKeep) {
    StubMain.resize(Count);
    StubBytes = int64(Count);
    bStubKeep = bKeep;
  }
  virtual int64 StubUpload() override {
    if (!bStubKeep) std::vector<uint8>().swap(StubMain);
    return StubBytes;
  }
  int64 StubBytes = 0;
  bool bStubKeep = true;
};

struct FStaticMeshDataType {
  int StubBound = 0;
};
class FVertexFactory : public FRenderResource {};
class FLocalVertexFactory : public FVertexFactory {
 public:
  using FDataType = FStaticMeshDataType;
  FLocalVertexFactory(ERHIFeatureLevel::Type, const char*) {}
  void SetData(FRHICommandListBase&, const FDataType& Data) { StubData = Data; }
  FDataType StubData;
};

class FPositionVertexBuffer : public FStubBuffer {
 public:
  void Init(uint32 Count, bool bNeedsCPUAccess = true) {
    Num = Count;
    StubResize(sizeof(FVector3f) * Count, bNeedsCPUAccess);
  }
  FVector3f& VertexPosition(uint32 Index) { return reinterpret_cast<FVector3f*>(StubMain.data())[Index]; }
  uint32 GetStride() const { return sizeof(FVector3f); }
  uint32 GetNumVertices() const { return Num; }
  void BindPositionVertexBuffer(const FVertexFactory*, FStaticMeshDataType& Data) const { Data.StubBound |= 1; }

 private:
  uint32 Num = 0;
};

class FStaticMeshVertexBuffer : public FStubBuffer {
 public:
  void SetUseHighPrecisionTangentBasis(bool bUse) { TangentBytes = bUse ? 16 : 8; }
  void SetUseFullPrecisionUVs(bool bUse) { UvBytes = bUse ? 8 : 4; }
  void Init(uint32 Count, uint32 Uvs, bool bNeedsCPUAccess = true) {
    Num = Count;
    NumUvs = Uvs;
    StubResize(GetResourceSize(), bNeedsCPUAccess);
  }
  void SetVertexTangents(uint32 Index, FVector3f, FVector3f, FVector3f Normal) {
    StubMain.at(std::size_t(Index) * TangentBytes) = uint8(int(Normal.Z * 127.0f));
  }
  void SetVertexUV(uint32 Index, uint32, const FVector2f&, bool = false) {
    StubMain.at(std::size_t(Num) * TangentBytes + std::size_t(Index) * UvBytes) = 1;
  }
  uint32 GetResourceSize() const { return Num * (TangentBytes + UvBytes * NumUvs); }
  void BindTangentVertexBuffer(const FVertexFactory*, FStaticMeshDataType& Data) const { Data.StubBound |= 2; }
  void BindPackedTexCoordVertexBuffer(const FVertexFactory*, FStaticMeshDataType& Data, int32 = -1) const {
    Data.StubBound |= 4;
  }
  void BindLightMapVertexBuffer(const FVertexFactory*, FStaticMeshDataType& Data, int) const { Data.StubBound |= 8; }

 private:
  uint32 Num = 0, NumUvs = 0, TangentBytes = 8, UvBytes = 4;
};

class FColorVertexBuffer : public FStubBuffer {
 public:
  void Init(uint32 Count, bool bNeedsCPUAccess = true) {
    Num = Count;
    StubResize(sizeof(FColor) * Count, bNeedsCPUAccess);
  }
  FColor& VertexColor(uint32 Index) { return reinterpret_cast<FColor*>(StubMain.data())[Index]; }
  uint32 GetStride() const { return sizeof(FColor); }
  uint32 GetNumVertices() const { return Num; }
  void BindColorVertexBuffer(const FVertexFactory*, FStaticMeshDataType& Data) const { Data.StubBound |= 16; }

 private:
  uint32 Num = 0;
};

class FIndexBuffer : public FStubBuffer {};
namespace EIndexBufferStride {
enum Type { Force16Bit = 1, Force32Bit = 2 };
} // namespace EIndexBufferStride
class FRawStaticIndexBuffer : public FIndexBuffer {
 public:
  FRawStaticIndexBuffer(bool bNeedsCPUAccess = false) { bStubKeep = bNeedsCPUAccess; }
  void SetIndices(const TArray<uint32>& Indices, EIndexBufferStride::Type Stride) {
    StubResize(std::size_t(Indices.Num()) * (Stride == EIndexBufferStride::Force16Bit ? 2 : 4), bStubKeep);
  }
  uint32 GetIndexDataSize() const { return uint32(StubBytes); }
};

// ---- what is drawn

struct FPrimitiveViewRelevance {
  bool bDrawRelevance = false, bShadowRelevance = false, bDynamicRelevance = false, bRenderInMainPass = false,
       bUsesLightingChannels = false, bRenderCustomDepth = false, bOpaque = false;
};
struct FMaterialRelevance {
  bool bOpaque = false;
  bool bDisableDepthTest = false;
  void SetPrimitiveViewRelevance(FPrimitiveViewRelevance& Out) const { Out.bOpaque = bOpaque; }
};
class FMaterialRenderProxy {};

struct FConvexVolume {
  /// What it holds of the world; everything by default.
  bool IntersectBox(const FVector& Centre, const FVector& Extent) const {
    return Centre.X - Extent.X <= StubMostX && Centre.X + Extent.X >= StubLeastX;
  }
  double StubLeastX = -1.0e12, StubMostX = 1.0e12;
};
class FSceneView {
 public:
  FConvexVolume ViewFrustum;
  const FConvexVolume* GetDynamicMeshElementsShadowCullFrustum() const { return StubShadow; }
  const FConvexVolume* StubShadow = nullptr;
};
class FSceneViewFamily {};

class FStubUniformBuffer {};
struct FDynamicPrimitiveUniformBuffer {
  FStubUniformBuffer UniformBuffer;
  void Set(FRHICommandListBase&, const FMatrix&, const FMatrix&, const FBoxSphereBounds&, const FBoxSphereBounds&, bool, bool,
      bool) {}
};

enum EPrimitiveType { PT_TriangleList };
enum ESceneDepthPriorityGroup { SDPG_World };
struct FMeshBatchElement {
  const FIndexBuffer* IndexBuffer = nullptr;
  const FStubUniformBuffer* PrimitiveUniformBufferResource = nullptr;
  uint32 FirstIndex = 0, NumPrimitives = 0, MinVertexIndex = 0, MaxVertexIndex = 0;
};
struct FMeshBatch {
  FMeshBatchElement Elements[1];
  const FVertexFactory* VertexFactory = nullptr;
  const FMaterialRenderProxy* MaterialRenderProxy = nullptr;
  bool ReverseCulling = false, bCanApplyViewModeOverrides = false;
  EPrimitiveType Type = PT_TriangleList;
  ESceneDepthPriorityGroup DepthPriorityGroup = SDPG_World;
};
class FMeshElementCollector {
 public:
  template <typename T>
  T& AllocateOneFrameResource() {
    StubKept.push_back(std::make_shared<T>());
    return *static_cast<T*>(StubKept.back().get());
  }
  FMeshBatch& AllocateMesh() { return AllocateOneFrameResource<FMeshBatch>(); }
  void AddMesh(int32 View, FMeshBatch& Mesh) { StubMeshes.emplace_back(View, &Mesh); }
  FRHICommandListBase& GetRHICommandList() { return StubList; }
  std::vector<std::pair<int32, const FMeshBatch*>> StubMeshes;

 private:
  std::vector<std::shared_ptr<void>> StubKept;
  FRHICommandListBase StubList;
};

class FPrimitiveSceneInfo;
class FSceneInterface {
 public:
  ERHIFeatureLevel::Type GetFeatureLevel() const { return ERHIFeatureLevel::SM5; }
  EShaderPlatform GetShaderPlatform() const { return SP_NumPlatforms; }
  void GetPrimitiveUniformShaderParameters_RenderThread(
      const FPrimitiveSceneInfo*, bool& bLightmap, FMatrix& Previous, int32& Capture, bool& bVelocity) const {
    bLightmap = bVelocity = false;
    Previous = FMatrix();
    Capture = -1;
  }
};

inline uint8 GetDefaultLightingChannelMask() {
  return 1;
}

class UPrimitiveComponent;
class FPrimitiveSceneProxy {
 public:
  explicit FPrimitiveSceneProxy(const UPrimitiveComponent*) {}
  virtual ~FPrimitiveSceneProxy() = default;
  virtual SIZE_T GetTypeHash() const = 0;
  virtual uint32 GetMemoryFootprint() const = 0;
  virtual FPrimitiveViewRelevance GetViewRelevance(const FSceneView*) const { return FPrimitiveViewRelevance(); }
  virtual bool CanBeOccluded() const { return true; }
  virtual void GetDynamicMeshElements(
      const TArray<const FSceneView*>&, const FSceneViewFamily&, uint32, FMeshElementCollector&) const {}
  FSceneInterface& GetScene() const {
    static FSceneInterface Scene;
    return Scene;
  }
  SIZE_T GetAllocatedSize() const { return 0; }

 protected:
  bool IsShown(const FSceneView*) const { return true; }
  bool IsShadowCast(const FSceneView*) const { return true; }
  bool ShouldRenderInMainPass() const { return true; }
  bool ShouldRenderCustomDepth() const { return false; }
  bool ReceivesDecals() const { return true; }
  bool IsLocalToWorldDeterminantNegative() const { return false; }
  uint8 GetLightingChannelMask() const { return 1; }
  const FMatrix& GetLocalToWorld() const {
    static const FMatrix Identity{};
    return Identity;
  }
  const FBoxSphereBounds& GetBounds() const {
    static const FBoxSphereBounds None{FBox()};
    return None;
  }
  const FBoxSphereBounds& GetLocalBounds() const { return GetBounds(); }
  FPrimitiveSceneInfo* GetPrimitiveSceneInfo() const { return nullptr; }
  bool bVerifyUsedMaterials = true;
};
