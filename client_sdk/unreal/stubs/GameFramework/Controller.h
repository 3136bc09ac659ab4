#pragma once

#include "GameFramework/Actor.h"

class AController : public AActor
{
public:
	using Super = AController;
	virtual FRotator GetControlRotation() const
	{
		return StubView;
	}
	virtual void SetControlRotation(const FRotator& View)
	{
		StubView = View;
	}
	FRotator StubView;
};
