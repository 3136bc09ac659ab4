#pragma once

#include "Components/ActorComponent.h"

class USceneComponent : public UActorComponent {
 public:
  using Super = USceneComponent;
  void SetupAttachment(USceneComponent* Parent, FName = NAME_None) { StubParent = Parent; }
  void SetVisibility(bool bVisible, bool = false) { bStubVisible = bVisible; }
  FVector GetComponentLocation() const { return StubLocation; }
  FRotator GetComponentRotation() const { return FRotator(0.0, StubYaw, 0.0); }
  double StubYaw = 0.0;
  FVector GetForwardVector() const { return FVector(1.0, 0.0, 0.0); }
  void SetRelativeLocation(FVector Location) { StubLocation = Location; }
  void SetWorldLocation(FVector Location) { StubLocation = Location; }
  void SetWorldScale3D(FVector) {}
  USceneComponent* StubParent = nullptr;
  FVector StubLocation;
  bool bStubVisible = true;
};
