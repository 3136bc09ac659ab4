#pragma once

#include "TerraportMeshBackend.h"

/**
 * UProceduralMeshComponent, one component with one section for each mesh part. A section is shown and hidden by a flag of the
 * existing scene proxy (SetMeshSectionVisible), where SetVisibility would make a new proxy, and so upload the mesh anew.
 */
class FTerraportProceduralBackend final : public ITerraportMeshBackend
{
public:
	virtual TUniquePtr<FTerraportPreparedMesh> Prepare(const FTerraportMeshPart& Part) const override;
	virtual UPrimitiveComponent* Create(AActor& Owner, FTerraportPreparedMesh& Prepared, UMaterialInterface* Material,
		const FTerraportMeshSettings& Settings) override;
	virtual void SetShown(UPrimitiveComponent& Component, bool bShown) override;
	virtual SIZE_T BytesOf(int32 Vertices, int32 Indices) const override;
};
