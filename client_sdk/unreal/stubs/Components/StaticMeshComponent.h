#pragma once

#include "Components/PrimitiveComponent.h"

class UStaticMesh;

class UStaticMeshComponent : public UMeshComponent {
 public:
  using Super = UStaticMeshComponent;
  virtual bool SetStaticMesh(UStaticMesh*) { return true; }
};
