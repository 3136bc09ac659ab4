#pragma once

#include "Engine/World.h"

template <typename T>
class TActorIterator
{
public:
	explicit TActorIterator(const UWorld* World)
	{
		for (AActor* Actor : World->StubActors)
		{
			Found = Found != nullptr ? Found : dynamic_cast<T*>(Actor);
		}
	}
	explicit operator bool() const
	{
		return Found != nullptr;
	}
	T* operator*() const
	{
		return Found;
	}

private:
	T* Found = nullptr;
};
