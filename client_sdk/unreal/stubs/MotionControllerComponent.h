#pragma once

#include "Components/PrimitiveComponent.h"

class UMotionControllerComponent : public UPrimitiveComponent {
 public:
  using Super = UMotionControllerComponent;
  void SetTrackingMotionSource(const FName) {}
  bool IsTracked() const { return false; }
};
