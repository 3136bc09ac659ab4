#pragma once

#include "Components/SceneComponent.h"

class AController;
struct FHitResult;
struct FPropertyChangedEvent {};

enum class ETeleportType : uint8 { None, TeleportPhysics };

class AActor : public UObject {
 public:
  using Super = AActor;
  FActorTickFunction PrimaryActorTick;
  virtual void BeginPlay() {}
  virtual void EndPlay(const EEndPlayReason::Type) {}
  virtual void Tick(float) {}
  virtual bool ShouldTickIfViewportsOnly() const { return false; }
  virtual void Destroyed() {}
  virtual void PostEditChangeProperty(FPropertyChangedEvent&) {}
  template <typename T>
  T* CreateDefaultSubobject(FName) {
    T* Component = new T();
    Component->StubOwner = this;
    return Component;
  }
  bool SetRootComponent(USceneComponent* Component) {
    StubRoot = Component;
    return true;
  }
  USceneComponent* GetRootComponent() const { return StubRoot; }
  const FTransform& GetActorTransform() const { return StubTransform; }
  FVector GetActorLocation() const { return StubTransform.StubLocation; }
  FRotator GetActorRotation() const { return FRotator(0.0, StubTransform.YawDegrees, 0.0); }
  FVector GetActorScale3D() const { return FVector(1.0, 1.0, 1.0); }
  bool SetActorLocation(const FVector& Location, bool = false, FHitResult* = nullptr, ETeleportType = ETeleportType::None) {
    StubTransform.StubLocation = Location;
    return true;
  }
  void AddActorWorldRotation(FRotator Turn) { StubTransform.YawDegrees += Turn.Yaw; }
  void AddActorWorldOffset(FVector Offset) { StubTransform.StubLocation += Offset; }
  /// Of the pawn that this is, or that it was made by.
  AController* GetInstigatorController() const { return StubController; }
  AController* StubController = nullptr;
  virtual float GetSimpleCollisionHalfHeight() const { return 0.0f; }
  UWorld* GetWorld() const { return StubWorld; }
  template <typename T>
  T* FindComponentByClass() const {
    return static_cast<T*>(StubFound);
  }
  FTransform StubTransform;
  UWorld* StubWorld = nullptr;
  /// What is found, whatever the class: without run-time type information nobody can tell.
  UActorComponent* StubFound = nullptr;

 private:
  USceneComponent* StubRoot = nullptr;
};
