#pragma once

#include "CoreMinimal.h"

class AActor;
class UMaterialInterface;
class UPrimitiveComponent;

/** One mesh in Unreal's axes: a segment, or a block of the base. Centimetres about the scene's origin. */
struct TERRAPORT_API FTerraportMeshPart
{
	TArray<FVector3f> Positions;
	/** Unit, one for each position. */
	TArray<FVector3f> Normals;
	/** One for each position, or empty. */
	TArray<FColor> Colours;
	/** One for each position, or empty; (0, 0) is the image's upper left corner. */
	TArray<FVector2f> Uvs;
	/** Three for each face. */
	TArray<uint32> Indices;
	FBox3f Bounds = FBox3f(ForceInit);
};

/** What a backend prepared of a mesh part on a worker thread. A backend derives its own class from it. */
class TERRAPORT_API FTerraportPreparedMesh
{
public:
	virtual ~FTerraportPreparedMesh() = default;
};

/** Settings of every component, from the scene's properties. */
struct TERRAPORT_API FTerraportMeshSettings
{
	/** Cook collision, away from the game thread. */
	bool bCollision = false;
	bool bCastShadow = false;
};

/** A mesh that a backend made: a component, and which of the component's meshes it is. */
struct TERRAPORT_API FTerraportPiece
{
	UPrimitiveComponent* Component = nullptr;
	int32 Index = 0;
};

/**
 * Draws meshes. Two are built in; another one (RealtimeMesh, a component of your own) is set by
 * ATerraportScene::SetMeshBackend before Open.
 *
 * What is made must cost nothing worth mentioning to show and to hide: a swap does that to hundreds in one frame.
 */
class TERRAPORT_API ITerraportMeshBackend
{
public:
	virtual ~ITerraportMeshBackend() = default;

	/** Turn a mesh part into what the component takes. Called on worker threads, several at a time; must touch no UObject. */
	virtual TUniquePtr<FTerraportPreparedMesh> Prepare(const FTerraportMeshPart& Part) const = 0;

	/**
	 * Make a mesh, not to be seen yet, in a component that is attached to the owner's root with no offset and registered: a new
	 * one, or one that has others already. All of its cost for the game thread should fall into this call, since the frame's
	 * time budget is measured around it. A null component where that is impossible.
	 */
	virtual FTerraportPiece Create(AActor& Owner, FTerraportPreparedMesh& Prepared, UMaterialInterface* Material,
		const FTerraportMeshSettings& Settings) = 0;

	/** Show or hide what Create made. */
	virtual void SetShown(const FTerraportPiece& Piece, bool bShown) = 0;

	/** Free what Create made. A component whose last piece this was is destroyed by the caller, afterwards; it may have been
	 * destroyed with its level before. */
	virtual void Remove(const FTerraportPiece& Piece) = 0;

	/** Estimate of the bytes that a mesh takes: on the GPU, and what the component keeps in main memory. */
	virtual SIZE_T BytesOf(int32 Vertices, int32 Indices) const = 0;
};
