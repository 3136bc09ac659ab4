#pragma once

#include "TerraportMeshBackend.h"

/**
 * UDynamicMeshComponent, one for each mesh part: for projects that go on with Geometry Script. It has no flag like a section's:
 * showing one makes its render state, in the frame of the swap.
 */
class FTerraportDynamicBackend final : public ITerraportMeshBackend
{
public:
	virtual TUniquePtr<FTerraportPreparedMesh> Prepare(const FTerraportMeshPart& Part) const override;
	virtual UPrimitiveComponent* Create(AActor& Owner, FTerraportPreparedMesh& Prepared, UMaterialInterface* Material,
		const FTerraportMeshSettings& Settings) override;
	virtual void SetShown(UPrimitiveComponent& Component, bool bShown) override;
	virtual SIZE_T BytesOf(int32 Vertices, int32 Indices) const override;
};
