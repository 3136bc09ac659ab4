#pragma once

#include "GameFramework/Actor.h"

class APlayerCameraManager : public AActor {
 public:
  using Super = APlayerCameraManager;
  virtual void StartCameraFade(float From, float To, float, FLinearColor, bool = false, bool bHold = false) {
    StubFades.push_back({From, To});
    bStubHeld = bHold;
  }
  std::vector<std::pair<float, float>> StubFades;
  bool bStubHeld = false;
};
