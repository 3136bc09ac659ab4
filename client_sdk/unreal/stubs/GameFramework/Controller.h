#pragma once

#include "GameFramework/Actor.h"

class APawn;

class AController : public AActor {
 public:
  using Super = AController;
  virtual FRotator GetControlRotation() const { return StubView; }
  virtual void SetControlRotation(const FRotator& View) { StubView = View; }
  APawn* GetPawn() const { return StubPawn; }
  FRotator StubView;
  APawn* StubPawn = nullptr;
};
