#pragma once

#include "CollisionQueryParams.h"
#include "GameFramework/Actor.h"
#include "StubRendering.h"

class APlayerController;

namespace EWorldType {
enum Type { None, Game, Editor };
} // namespace EWorldType

class UWorld : public UObject {
 public:
  APlayerController* GetFirstPlayerController() const { return StubPlayer; }
  ERHIFeatureLevel::Type GetFeatureLevel() const { return ERHIFeatureLevel::SM5; }
  TEnumAsByte<EWorldType::Type> WorldType = EWorldType::Game;
  /// Of the cameras of all viewports.
  TArray<FVector> ViewLocationsRenderedLastFrame;
  /// Whether a wall of the stubs, an upright plane across X of one object type, lies between.
  bool LineTraceTestByObjectType(const FVector& Start, const FVector& End, const FCollisionObjectQueryParams& Types,
      const FCollisionQueryParams& Parameters = FCollisionQueryParams()) const {
    const bool bAsked = Types.StubTypes.count(StubWallType) > 0 && Parameters.StubIgnored.count(StubWallOf) == 0;
    return bAsked && (Start.X - StubWallX) * (End.X - StubWallX) < 0.0;
  }
  int StubWallType = -1;
  double StubWallX = 0.0;
  const AActor* StubWallOf = nullptr;
  FSceneInterface* Scene = nullptr;
  APlayerController* StubPlayer = nullptr;
  /// The one that iterators find.
  AActor* StubActor = nullptr;
};
