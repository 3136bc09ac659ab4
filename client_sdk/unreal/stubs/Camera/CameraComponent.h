#pragma once

#include "Components/SceneComponent.h"

class UCameraComponent : public USceneComponent {
 public:
  using Super = UCameraComponent;
  bool bUsePawnControlRotation = false;
};
