#pragma once

#include "GameFramework/Controller.h"

class APlayerCameraManager;

class APlayerController : public AController {
 public:
  using Super = APlayerController;
  TObjectPtr<APlayerCameraManager> PlayerCameraManager;
};
