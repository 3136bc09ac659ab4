#pragma once

#include "Engine/EngineTypes.h"

#include <set>

class AActor;

struct FCollisionQueryParams {
  void AddIgnoredActor(const AActor* Actor) { StubIgnored.insert(Actor); }
  std::set<const AActor*> StubIgnored;
};

struct FCollisionObjectQueryParams {
  explicit FCollisionObjectQueryParams(const TArray<TEnumAsByte<EObjectTypeQuery>>& Types) {
    for (const TEnumAsByte<EObjectTypeQuery>& Type : Types) StubTypes.insert(int(EObjectTypeQuery(Type)));
  }
  std::set<int> StubTypes;
};
