#pragma once

#include "CoreMinimal.h"

/** Keeps alive what only plain C++ points to. */
class ITerraportKeeper
{
public:
	virtual ~ITerraportKeeper() = default;
	/** Hold on to an object until Release; once each. */
	virtual void Keep(UObject* Object) = 0;
	virtual void Release(UObject* Object) = 0;
};

/** Keeps objects by a set that the garbage collector follows: a property of the scene actor, which outlives this. */
class FTerraportKeeper final : public ITerraportKeeper
{
public:
	explicit FTerraportKeeper(TSet<TObjectPtr<UObject>>& InReferencedObjects) : ReferencedObjects(InReferencedObjects) {}

	virtual void Keep(UObject* Object) override { ReferencedObjects.Add(Object); }
	virtual void Release(UObject* Object) override { ReferencedObjects.Remove(Object); }

private:
	TSet<TObjectPtr<UObject>>& ReferencedObjects;
};
