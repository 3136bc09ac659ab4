#pragma once

#include "CoreMinimal.h"

#include "LocalVertexFactory.h"
#include "RawIndexBuffer.h"
#include "Rendering/ColorVertexBuffer.h"
#include "Rendering/PositionVertexBuffer.h"
#include "Rendering/StaticMeshVertexBuffer.h"

class FRHICommandListBase;
struct FTerraportMeshPart;
class UMaterialInterface;

/**
 * One mesh on the graphics: buffers in the engine's own packed forms, whose copy in main memory goes when they are uploaded
 * (outside the editor, which keeps it).
 *
 * A worker fills it, the game thread hands it to the render thread, and from there on it is the render thread's alone.
 */
class FTerraportGroundPiece final
{
public:
	/** Bytes of a vertex: place, normal and tangent of 8 bits each, one pair of 16-bit texture coordinates, colour. */
	static constexpr SIZE_T VertexBytes = 12 + 8 + 4 + 4;
	/** Of a corner where there are at most this many vertices, else twice. */
	static constexpr SIZE_T CornerBytes = 2;
	static constexpr int32 MaxShortVertices = 65536;

	/** Worker. */
	explicit FTerraportGroundPiece(const FTerraportMeshPart& Part);
	FTerraportGroundPiece(const FTerraportGroundPiece&) = delete;
	FTerraportGroundPiece& operator=(const FTerraportGroundPiece&) = delete;

	/** Render thread: upload. */
	void Init(FRHICommandListBase& RHICmdList, ERHIFeatureLevel::Type FeatureLevel);
	/** Render thread, before it is destroyed; nothing where it was never uploaded. */
	void Release();

	uint32 NumTriangles() const { return uint32(NumCorners / 3); }
	/** What it takes on the graphics. */
	SIZE_T GpuBytes() const;

	const FBox Bounds;
	/** Followed by the garbage collector through the component, which has it too. */
	const UMaterialInterface* Material = nullptr;
	bool bShown = false;
	FRawStaticIndexBuffer Indices;
	TUniquePtr<FLocalVertexFactory> VertexFactory;
	const int32 NumVertices;

private:
	FPositionVertexBuffer Positions;
	FStaticMeshVertexBuffer Tangents;
	/** Empty where a texture is drawn. */
	FColorVertexBuffer Colours;
	const int32 NumCorners;
};
