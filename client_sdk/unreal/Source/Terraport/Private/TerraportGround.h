#pragma once

#include "CoreMinimal.h"

#include <vector>

/** Where a ray met a mesh, in the mesh's own space. */
struct FTerraportGroundPoint
{
	/** Along the ray, in lengths of its direction. */
	float At = 0.0f;
	/** Unit, by the front of the face. */
	FVector3f Normal = FVector3f::ZeroVector;
};

/**
 * A mesh that rays are cast against, in component space (centimetres): teleports need the ground that is shown, and cooking
 * collision for every segment would cost more than all the rest. Boxes over 64 consecutive faces keep a ray to few of them.
 */
class FTerraportGroundMesh
{
public:
	FTerraportGroundMesh() = default;
	/** `Indices` are below the number of positions. Both are copied. O(faces). */
	FTerraportGroundMesh(const TArray<FVector3f>& InPositions, const TArray<uint32>& InIndices);

	/** First point of the ray at 0 < At <= MaxAt, whichever way the face looks; false where there is none. */
	bool Cast(const FVector3f& Origin, const FVector3f& Direction, float MaxAt, FTerraportGroundPoint& Point) const;

	/** Every point of the ray at 0 < At <= MaxAt, in no order, added to `Points`. */
	void CastAll(
		const FVector3f& Origin, const FVector3f& Direction, float MaxAt, std::vector<FTerraportGroundPoint>& Points) const;

	bool IsEmpty() const { return Indices.Num() == 0; }

	SIZE_T Bytes() const
	{
		return SIZE_T(Positions.Num()) * sizeof(FVector3f) + SIZE_T(Indices.Num()) * sizeof(uint32) +
			Boxes.size() * sizeof(FBox3f);
	}

private:
	template <typename Visit>
	void VisitHits(const FVector3f& Origin, const FVector3f& Direction, float MaxAt, Visit&& Take) const;

	TArray<FVector3f> Positions;
	TArray<uint32> Indices;
	/** The whole mesh, then one for every 64 faces. */
	FBox3f Whole = FBox3f(ForceInit);
	std::vector<FBox3f> Boxes;
};
