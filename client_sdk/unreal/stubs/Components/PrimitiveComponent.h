#pragma once

#include "Components/SceneComponent.h"
#include "StubRendering.h"

#include <vector>

class UMaterialInterface;

namespace ECollisionEnabled {
enum Type { NoCollision, QueryAndPhysics = 3 };
} // namespace ECollisionEnabled

class UPrimitiveComponent : public USceneComponent {
 public:
  using Super = UPrimitiveComponent;
  void SetCastShadow(bool) {}
  virtual void SetCollisionEnabled(ECollisionEnabled::Type Type) { StubCollision = Type; }
  virtual void SetMaterial(int32, UMaterialInterface* Material) { StubMaterial = Material; }
  virtual FPrimitiveSceneProxy* CreateSceneProxy() { return nullptr; }
  virtual FBoxSphereBounds CalcBounds(const FTransform&) const { return FBoxSphereBounds(FBox()); }
  virtual int32 GetNumMaterials() const { return 1; }
  virtual UMaterialInterface* GetMaterial(int32) const { return StubMaterial; }
  virtual void OnComponentDestroyed(bool) {}
  virtual void DestroyComponent(bool bPromoteChildren = false) override {
    OnComponentDestroyed(false);
    USceneComponent::DestroyComponent(bPromoteChildren);
  }
  void UpdateBounds() { ++StubBoundsUpdates; }
  void MarkRenderTransformDirty() {}
  FMaterialRelevance GetMaterialRelevance(ERHIFeatureLevel::Type) const { return FMaterialRelevance{true, false}; }
#if STUB_ENGINE_MINOR >= 7
  FMaterialRelevance GetMaterialRelevance(EShaderPlatform) const { return FMaterialRelevance{true, false}; }
#endif
  int StubBoundsUpdates = 0;
  /// Every one that was ever made.
  static inline std::vector<UPrimitiveComponent*> StubAll;
  UPrimitiveComponent() { StubAll.push_back(this); }
  ECollisionEnabled::Type StubCollision = ECollisionEnabled::QueryAndPhysics;
  UMaterialInterface* StubMaterial = nullptr;
};

class UMeshComponent : public UPrimitiveComponent {
 public:
  using Super = UMeshComponent;
};
