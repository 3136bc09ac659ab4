#pragma once

#include "CoreMinimal.h"

class FMaterialRenderProxy;

class UMaterialInterface : public UObject {
 public:
  virtual FMaterialRenderProxy* GetRenderProxy() const { return nullptr; }
};
