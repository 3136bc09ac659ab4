#pragma once

#include "Engine/World.h"

template <typename T>
class TActorIterator
{
public:
	explicit TActorIterator(const UWorld* World) : Found(static_cast<T*>(World->StubActor)) {}
	explicit operator bool() const { return Found != nullptr; }
	T* operator*() const { return Found; }

private:
	T* Found = nullptr;
};
