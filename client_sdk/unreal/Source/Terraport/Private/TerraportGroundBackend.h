#pragma once

#include "TerraportMeshBackend.h"

#include <vector>

class UTerraportGroundComponent;

/**
 * UTerraportGroundComponent: up to 16 pieces in each, of those that lie close together. Packed as the graphics read them and
 * kept there alone, so there is nothing to cook collision from: scenes with bCollision draw by dynamic components.
 */
class FTerraportGroundBackend final : public ITerraportMeshBackend
{
public:
	virtual TUniquePtr<FTerraportPreparedMesh> Prepare(const FTerraportMeshPart& Part) const override;
	virtual FTerraportPiece Create(AActor& Owner, FTerraportPreparedMesh& Prepared, UMaterialInterface* Material,
		const FTerraportMeshSettings& Settings) override;
	virtual void SetShown(const FTerraportPiece& Piece, bool bShown) override;
	virtual void Remove(const FTerraportPiece& Piece) override;
	virtual SIZE_T BytesOf(int32 Vertices, int32 Indices) const override;

private:
	UTerraportGroundComponent* FindRoom(const FBox& Bounds) const;

	/** Of the one actor that a scene draws by. Those with pieces; a component is held by whoever asked for its first piece,
	 * until the last one is removed. */
	std::vector<UTerraportGroundComponent*> Components;
};
