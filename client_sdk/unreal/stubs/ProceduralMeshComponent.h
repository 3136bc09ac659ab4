#pragma once

#include "Components/PrimitiveComponent.h"

struct FProcMeshTangent {
  FVector TangentX;
  bool bFlipTangentY = false;
  FProcMeshTangent() : TangentX(1.0, 0.0, 0.0) {}
  FProcMeshTangent(float X, float Y, float Z) : TangentX(X, Y, Z) {}
};

struct FProcMeshVertex {
  FVector Position;
  FVector Normal;
  FProcMeshTangent Tangent;
  FColor Color;
  FVector2D UV0, UV1, UV2, UV3;
};

struct FProcMeshSection {
  TArray<FProcMeshVertex> ProcVertexBuffer;
  TArray<uint32> ProcIndexBuffer;
  FBox SectionLocalBox;
  bool bEnableCollision = false;
  bool bSectionVisible = true;
};

class UProceduralMeshComponent : public UMeshComponent {
 public:
  using Super = UProceduralMeshComponent;
  bool bUseAsyncCooking = false;
  void SetProcMeshSection(int32, const FProcMeshSection& Section) { StubSection = Section; }
  FProcMeshSection* GetProcMeshSection(int32) { return &StubSection; }
  void SetMeshSectionVisible(int32, bool bVisible) { StubSection.bSectionVisible = bVisible; }
  FProcMeshSection StubSection;

  /// Every one that was ever made.
  static inline std::vector<UProceduralMeshComponent*> StubAll;
  UProceduralMeshComponent() { StubAll.push_back(this); }
};
