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
	virtual FTerraportPiece Create(AActor& Owner, FTerraportPreparedMesh& Prepared, UMaterialInterface* Material,
		const FTerraportMeshSettings& Settings) override;
	virtual void SetShown(const FTerraportPiece& Piece, bool bShown) override;
	/** Nothing: the component goes with its one piece. */
	virtual void Remove(const FTerraportPiece&) override {}
	virtual SIZE_T BytesOf(int32 Vertices, int32 Indices) const override;
};
