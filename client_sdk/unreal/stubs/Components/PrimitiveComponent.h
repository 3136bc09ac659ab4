#pragma once

#include "Components/SceneComponent.h"

class UMaterialInterface;

namespace ECollisionEnabled
{
enum Type
{
	NoCollision,
	QueryAndPhysics = 3
};
} // namespace ECollisionEnabled

class UPrimitiveComponent : public USceneComponent
{
public:
	using Super = UPrimitiveComponent;
	void SetCastShadow(bool) {}
	virtual void SetCollisionEnabled(ECollisionEnabled::Type Type) { StubCollision = Type; }
	virtual void SetMaterial(int32, UMaterialInterface* Material) { StubMaterial = Material; }
	ECollisionEnabled::Type StubCollision = ECollisionEnabled::QueryAndPhysics;
	UMaterialInterface* StubMaterial = nullptr;
};

class UMeshComponent : public UPrimitiveComponent
{
public:
	using Super = UMeshComponent;
};
