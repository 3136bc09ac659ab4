#pragma once

#include "GameFramework/Actor.h"
#include "StubRendering.h"

class APlayerController;

class UWorld : public UObject
{
public:
	APlayerController* GetFirstPlayerController() const { return StubPlayer; }
	ERHIFeatureLevel::Type GetFeatureLevel() const { return ERHIFeatureLevel::SM5; }
	FSceneInterface* Scene = nullptr;
	APlayerController* StubPlayer = nullptr;
	/// The one that iterators find.
	AActor* StubActor = nullptr;
};
