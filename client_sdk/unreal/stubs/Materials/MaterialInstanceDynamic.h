#pragma once

#include "Materials/MaterialInterface.h"

class UTexture;

class UMaterialInstanceDynamic : public UMaterialInterface {
 public:
  static UMaterialInstanceDynamic* Create(UMaterialInterface* Parent, UObject*) {
    UMaterialInstanceDynamic* Instance = new UMaterialInstanceDynamic();
    Instance->StubParent = Parent;
    return Instance;
  }
  void SetScalarParameterValue(FName, float Value) { StubScalar = Value; }
  void SetTextureParameterValue(FName, UTexture* Value) { StubTexture = Value; }
  UMaterialInterface* StubParent = nullptr;
  float StubScalar = 0.0f;
  UTexture* StubTexture = nullptr;
};
