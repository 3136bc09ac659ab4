#pragma once

#include "CoreMinimal.h"

class AActor;
class UWorld;

enum ELevelTick { LEVELTICK_All = 2 };

namespace EEndPlayReason {
enum Type { Destroyed };
} // namespace EEndPlayReason

struct FTickFunction {
  bool bCanEverTick = false;
  bool bTickEvenWhenPaused = false;
};
using FActorTickFunction = FTickFunction;
struct FActorComponentTickFunction : FTickFunction {};

class UActorComponent : public UObject {
 public:
  using Super = UActorComponent;
  FActorComponentTickFunction PrimaryComponentTick;
  void RegisterComponent() { bStubRegistered = true; }
  virtual void DestroyComponent(bool = false) { bStubDestroyed = true; }
  AActor* GetOwner() const { return StubOwner; }
  UWorld* GetWorld() const { return StubWorld; }
  virtual void TickComponent(float, ELevelTick, FActorComponentTickFunction*) {}
  virtual void EndPlay(const EEndPlayReason::Type) {}
  AActor* StubOwner = nullptr;
  UWorld* StubWorld = nullptr;
  bool bStubRegistered = false;
};
