#include "TerraportGroundPiece.h"

#include "StaticMeshResources.h"
#include "TerraportMeshPart.h"

FTerraportGroundPiece::FTerraportGroundPiece(const FTerraportMeshPart& Part)
	: Bounds(FVector(Part.Bounds.Min), FVector(Part.Bounds.Max)), NumVertices(Part.Positions.Num()),
	  NumCorners(Part.Indices.Num())
{
	const bool bKeepInMainMemory = false;
	const uint32 Count = uint32(NumVertices);
	Positions.Init(Count, bKeepInMainMemory);
	// Both said, since they are the engine's default and the whole reckoning: 8-bit tangents, 16-bit texture coordinates.
	Tangents.SetUseHighPrecisionTangentBasis(false);
	Tangents.SetUseFullPrecisionUVs(false);
	Tangents.Init(Count, 1, bKeepInMainMemory);
	const bool bTextured = Part.Uvs.Num() > 0;
	const bool bColoured = !bTextured || Part.Colours.Num() > 0;
	if (bColoured)
	{
		Colours.Init(Count, bKeepInMainMemory);
	}
	for (uint32 Vertex = 0; Vertex < Count; ++Vertex)
	{
		const int32 At = int32(Vertex);
		Positions.VertexPosition(Vertex) = Part.Positions[At];
		// Nothing has a normal map: any tangents that are not parallel to the normal will do.
		Tangents.SetVertexTangents(Vertex, FVector3f(1.0f, 0.0f, 0.0f), FVector3f(0.0f, 1.0f, 0.0f), Part.Normals[At]);
		Tangents.SetVertexUV(Vertex, 0, bTextured ? Part.Uvs[At] : FVector2f(0.0f, 0.0f));
		if (bColoured)
		{
			Colours.VertexColor(Vertex) = Part.Colours.Num() > 0 ? Part.Colours[At] : FColor(200, 200, 200, 255);
		}
	}
	Indices.SetIndices(
		Part.Indices, NumVertices <= MaxShortVertices ? EIndexBufferStride::Force16Bit : EIndexBufferStride::Force32Bit);
}

void FTerraportGroundPiece::Init(FRHICommandListBase& RHICmdList, ERHIFeatureLevel::Type FeatureLevel)
{
	VertexFactory = MakeUnique<FLocalVertexFactory>(FeatureLevel, "FTerraportGroundPiece");
	Positions.InitResource(RHICmdList);
	Tangents.InitResource(RHICmdList);
	Colours.InitResource(RHICmdList);
	Indices.InitResource(RHICmdList);
	FLocalVertexFactory::FDataType Data;
	Positions.BindPositionVertexBuffer(VertexFactory.Get(), Data);
	Tangents.BindTangentVertexBuffer(VertexFactory.Get(), Data);
	Tangents.BindPackedTexCoordVertexBuffer(VertexFactory.Get(), Data);
	Tangents.BindLightMapVertexBuffer(VertexFactory.Get(), Data, 0);
	Colours.BindColorVertexBuffer(VertexFactory.Get(), Data);
	VertexFactory->SetData(RHICmdList, Data);
	VertexFactory->InitResource(RHICmdList);
}

void FTerraportGroundPiece::Release()
{
	if (!VertexFactory.IsValid())
	{
		return;
	}
	VertexFactory->ReleaseResource();
	Indices.ReleaseResource();
	Colours.ReleaseResource();
	Tangents.ReleaseResource();
	Positions.ReleaseResource();
	VertexFactory.Reset();
}

SIZE_T FTerraportGroundPiece::GpuBytes() const
{
	const SIZE_T Stride = SIZE_T(Positions.GetStride()) + SIZE_T(Colours.GetNumVertices() > 0 ? Colours.GetStride() : 0);
	return SIZE_T(NumVertices) * Stride + SIZE_T(Tangents.GetResourceSize()) + SIZE_T(Indices.GetIndexDataSize());
}
