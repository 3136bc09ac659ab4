#pragma once

#include "GameFramework/Controller.h"

class UInputComponent;

class APawn : public AActor {
 public:
  using Super = APawn;
  TObjectPtr<AController> Controller;
  virtual void SetupPlayerInputComponent(UInputComponent*) {}
  virtual void AddControllerYawInput(float) {}
  virtual void AddControllerPitchInput(float) {}
};
