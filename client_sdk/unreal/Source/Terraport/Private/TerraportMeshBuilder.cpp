#include "TerraportMeshBuilder.h"

#include "TerraportAxes.h"

#include <algorithm>

namespace TerraportMeshBuilder
{
namespace
{
static_assert(sizeof(FVector3f) == 3 * sizeof(float), "three floats and nothing else");
static_assert(sizeof(FVector2f) == 2 * sizeof(float), "two floats and nothing else");

float* FloatsOf(TArray<FVector3f>& Vectors)
{
	return reinterpret_cast<float*>(Vectors.GetData());
}

/** A colour as the material takes it. */
FColor Coded(FColor Srgb, ETerraportVertexColours Coding)
{
	if (Coding == ETerraportVertexColours::Srgb)
	{
		return Srgb;
	}
	const auto Linear = [](uint8 Level) { return uint8((uint32(TerraportTexture::LinearOf(Level)) * 255 + 32767) / 65535); };
	return FColor(Linear(Srgb.R), Linear(Srgb.G), Linear(Srgb.B), 255);
}

void BuildColours(const terraport::SegmentMesh& Mesh, ETerraportVertexColours Coding, TArray<FColor>& Out)
{
	const int32 Count = int32(Mesh.vertexCount);
	if (!Mesh.hasColours)
	{
		Out.Reset();
		return;
	}
	Out.SetNumUninitialized(Count);
	for (int32 Vertex = 0; Vertex < Count; ++Vertex)
	{
		const uint8* Rgb = &Mesh.colours[4 * std::size_t(Vertex)];
		Out[Vertex] = Coded(FColor(Rgb[0], Rgb[1], Rgb[2], 255), Coding);
	}
}
} // namespace

void BuildPart(const terraport::SegmentMesh& Mesh, ETerraportVertexColours Colours, FTerraportMeshPart& Part)
{
	const std::size_t Count = Mesh.vertexCount;
	Part.Positions.SetNumUninitialized(int32(Count));
	if (Mesh.positionForm == terraport::VertexForm::Codes)
	{
		const float Translation[3] = {float(Mesh.translation[0]), float(Mesh.translation[1]), float(Mesh.translation[2])};
		TerraportAxes::PositionsToUnreal(
			Mesh.positionCodes.data(), Count, Translation, float(Mesh.stepM), FloatsOf(Part.Positions));
	}
	else
	{
		TerraportAxes::PositionsToUnreal(Mesh.positions.data(), Count, FloatsOf(Part.Positions));
	}
	Part.Normals.SetNumUninitialized(int32(Count));
	TerraportAxes::NormalsToUnreal(Mesh.normalCodes.data(), Count, FloatsOf(Part.Normals));
	BuildColours(Mesh, Colours, Part.Colours);
	if (Mesh.hasUvs)
	{
		Part.Uvs.SetNumUninitialized(int32(Count));
		Mesh.writeUvs(reinterpret_cast<float*>(Part.Uvs.GetData()));
	}
	else
	{
		Part.Uvs.Reset();
	}
	Part.Indices.SetNumUninitialized(int32(Mesh.indices.size()));
	TerraportAxes::IndicesToUnreal(Mesh.indices.data(), Mesh.indices.size(), Part.Indices.GetData());
	Part.Bounds = FBox3f(ForceInit);
	for (const FVector3f& Position : Part.Positions)
	{
		Part.Bounds += Position;
	}
}

FColor MeanColourOf(const terraport::SegmentMesh& Mesh, const std::vector<terraport::RegionFacts>& Regions)
{
	double Sum[3] = {0.0, 0.0, 0.0}, Weight = 0.0;
	const auto Add = [&Sum, &Weight](const terraport::RegionFacts& Region, double Share) {
		if (Region.meanColour && Share > 0.0)
		{
			Sum[0] += Share * Region.meanColour->x;
			Sum[1] += Share * Region.meanColour->y;
			Sum[2] += Share * Region.meanColour->z;
			Weight += Share;
		}
	};
	for (std::size_t Vertex = 0; Mesh.hasRegionIds && Vertex < Mesh.vertexCount; ++Vertex)
	{
		const std::size_t Region = Mesh.regionIds[Vertex];
		if (Region < Regions.size())
		{
			Add(Regions[Region], 1.0);
		}
	}
	if (Weight == 0.0)
	{
		for (const terraport::RegionFacts& Region : Regions)
		{
			Add(Region, Region.areaM2.value_or(1.0));
		}
	}
	if (Weight == 0.0)
	{
		return FColor(200, 200, 200, 255);
	}
	const auto Level = [&Sum, Weight](int Channel) { return uint8(FMath::Clamp(Sum[Channel] / Weight + 0.5, 0.0, 255.0)); };
	return FColor(Level(0), Level(1), Level(2), 255);
}

void FillColour(FColor Srgb, ETerraportVertexColours Coding, FTerraportMeshPart& Part)
{
	const FColor Colour = Coded(Srgb, Coding);
	Part.Colours.SetNumUninitialized(Part.Positions.Num());
	for (FColor& Vertex : Part.Colours)
	{
		Vertex = Colour;
	}
	Part.Uvs.Reset();
}

void CutPart(const FTerraportMeshPart& Whole, uint32 First, uint32 Count, FTerraportMeshPart& Part)
{
	Part = FTerraportMeshPart();
	// The vertices that are used, each once, in ascending order.
	std::vector<uint32> UsedVertices(
		Whole.Indices.GetData() + 3 * std::size_t(First), Whole.Indices.GetData() + 3 * std::size_t(First + Count));
	const std::vector<uint32> Corners = UsedVertices;
	std::sort(UsedVertices.begin(), UsedVertices.end());
	UsedVertices.erase(std::unique(UsedVertices.begin(), UsedVertices.end()), UsedVertices.end());
	Part.Positions.Reserve(int32(UsedVertices.size()));
	Part.Normals.Reserve(int32(UsedVertices.size()));
	for (const uint32 Vertex : UsedVertices)
	{
		Part.Positions.Add(Whole.Positions[int32(Vertex)]);
		Part.Normals.Add(Whole.Normals[int32(Vertex)]);
		Part.Bounds += Whole.Positions[int32(Vertex)];
		if (Whole.Colours.Num() > 0)
		{
			Part.Colours.Add(Whole.Colours[int32(Vertex)]);
		}
		if (Whole.Uvs.Num() > 0)
		{
			Part.Uvs.Add(Whole.Uvs[int32(Vertex)]);
		}
	}
	Part.Indices.Reserve(int32(Corners.size()));
	for (const uint32 Vertex : Corners)
	{
		Part.Indices.Add(uint32(std::lower_bound(UsedVertices.begin(), UsedVertices.end(), Vertex) - UsedVertices.begin()));
	}
}
} // namespace TerraportMeshBuilder

void FTerraportSegmentData::Build(const terraport::SegmentMesh& Mesh, terraport::ByteSpan Payload,
	const ITerraportMeshBackend& Backend, ETerraportVertexColours Colours, const std::vector<terraport::RegionFacts>& Regions)
{
	TerraportMeshBuilder::BuildPart(Mesh, Colours, Part);
	Vertices = Part.Positions.Num();
	Indices = Part.Indices.Num();
	Pixels = TerraportTexture::Decode(Mesh.image, Payload);
	Unread = Pixels.IsEmpty() ? Mesh.image.type : terraport::ImageType::None;
	if (Unread != terraport::ImageType::None && Part.Colours.Num() == 0)
	{
		TerraportMeshBuilder::FillColour(TerraportMeshBuilder::MeanColourOf(Mesh, Regions), Colours, Part);
	}
	Prepared = Backend.Prepare(Part);
	Ground = terraport::groundOf(Mesh);
}

TSharedRef<FTerraportBase, ESPMode::ThreadSafe> FTerraportBase::Build(
	const terraport::SceneFiles& Files, uint32 BlockFaces, ETerraportVertexColours Colours)
{
	TSharedRef<FTerraportBase, ESPMode::ThreadSafe> Base = MakeShared<FTerraportBase, ESPMode::ThreadSafe>();
	FTerraportMeshPart Whole;
	TerraportMeshBuilder::BuildPart(Files.base, Colours, Whole);
	Base->BlockFaces = BlockFaces;
	Base->Ground = terraport::groundOf(Files.base);
	if (Files.basePayload)
	{
		Base->Pixels = TerraportTexture::Decode(Files.base.image, terraport::viewOf(*Files.basePayload));
	}
	Base->Unread = Base->Pixels.IsEmpty() ? Files.base.image.type : terraport::ImageType::None;
	if (Base->Unread != terraport::ImageType::None && Whole.Colours.Num() == 0)
	{
		TerraportMeshBuilder::FillColour(TerraportMeshBuilder::MeanColourOf(Files.base, Files.regions), Colours, Whole);
	}
	for (uint32 First = 0; First < Files.base.faceCount; First += BlockFaces)
	{
		Base->Blocks.emplace_back();
		TerraportMeshBuilder::CutPart(Whole, First, std::min(BlockFaces, Files.base.faceCount - First), Base->Blocks.back());
	}
	return Base;
}
