#pragma once

#include "GameFramework/Actor.h"

class APlayerController;

class UWorld : public UObject
{
public:
	APlayerController* GetFirstPlayerController() const { return StubPlayer; }
	APlayerController* StubPlayer = nullptr;
	/// The one that iterators find.
	AActor* StubActor = nullptr;
};
