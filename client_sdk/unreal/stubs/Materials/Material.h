#pragma once

#include "Materials/MaterialInterface.h"

// Its values are in MaterialDomain.h, which does not come along.
enum EMaterialDomain : int;

class UMaterial : public UMaterialInterface {
 public:
  static UMaterial* GetDefaultMaterial(EMaterialDomain) {
    static UMaterial Default;
    return &Default;
  }
};
