#pragma once

#include "Components/PrimitiveComponent.h"
#include "DynamicMesh/DynamicMesh3.h"

class UBaseDynamicMeshComponent : public UMeshComponent
{
public:
	using Super = UBaseDynamicMeshComponent;
};

class UDynamicMeshComponent : public UBaseDynamicMeshComponent
{
public:
	using Super = UDynamicMeshComponent;
	bool bUseAsyncCooking = false;
	bool bEnableComplexCollision = false;
	void SetMesh(UE::Geometry::FDynamicMesh3&& Mesh) { StubMesh = std::move(Mesh); }
	void SetComplexAsSimpleCollisionEnabled(bool bEnabled, bool = true) { bEnableComplexCollision = bEnabled; }
	UE::Geometry::FDynamicMesh3 StubMesh;
};
