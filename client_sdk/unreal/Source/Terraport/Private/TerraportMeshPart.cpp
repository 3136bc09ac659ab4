#include "TerraportMeshPart.h"

#include "TerraportAxes.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace
{
/** Faces of a block of the base: about half a millisecond to make a mesh of. */
constexpr std::size_t BlockFaces = 2048;

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

/** Mean sRGB colour of the regions of a mesh's vertices; of all regions where it does not say which; else a light grey. */
FColor MeanColourOf(const terraport::SegmentMesh& Mesh, const std::vector<terraport::Region>& Regions)
{
	terraport::Vec3 Sum;
	double Weight = 0.0;
	const auto Add = [&Sum, &Weight](const terraport::Region& Region, double Share) {
		if (Region.meanColour)
		{
			Sum = {Sum.x + Share * Region.meanColour->x, Sum.y + Share * Region.meanColour->y,
				Sum.z + Share * Region.meanColour->z};
			Weight += Share;
		}
	};
	for (const std::uint16_t Region : Mesh.regions)
	{
		if (Region < Regions.size())
		{
			Add(Regions[Region], 1.0);
		}
	}
	for (std::size_t Region = 0; Weight == 0.0 && Mesh.regions.empty() && Region < Regions.size(); ++Region)
	{
		Add(Regions[Region], 1.0);
	}
	if (Weight == 0.0)
	{
		return FColor(200, 200, 200, 255);
	}
	const auto Level = [Weight](double Of) { return uint8(FMath::Clamp(Of / Weight + 0.5, 0.0, 255.0)); };
	return FColor(Level(Sum.x), Level(Sum.y), Level(Sum.z), 255);
}

/** Order of the faces along a curve over the ground (Morton, 1966), so that a block's faces lie together. */
std::vector<uint32> OrderOnGround(const terraport::SegmentMesh& Mesh)
{
	const auto Spread = [](uint32 Value) {
		Value = (Value | (Value << 8)) & 0x00FF00FF;
		Value = (Value | (Value << 4)) & 0x0F0F0F0F;
		Value = (Value | (Value << 2)) & 0x33333333;
		return (Value | (Value << 1)) & 0x55555555;
	};
	std::vector<uint32> Places(Mesh.faceCount);
	for (std::size_t Face = 0; Face < Places.size(); ++Face)
	{
		uint32 Cells[2];
		for (int Axis = 0; Axis < 2; ++Axis)
		{
			const std::size_t At = Axis == 0 ? 0 : 2;
			const float Side = std::max(Mesh.bounds.high[At] - Mesh.bounds.low[At], 1e-6f);
			const float Corner = Mesh.positions[3 * std::size_t(Mesh.indices[3 * Face]) + At];
			Cells[Axis] = uint32(FMath::Clamp((Corner - Mesh.bounds.low[At]) / Side * 65535.0f, 0.0f, 65535.0f));
		}
		Places[Face] = Spread(Cells[0]) | (Spread(Cells[1]) << 1);
	}
	std::vector<uint32> Order(Mesh.faceCount);
	std::iota(Order.begin(), Order.end(), 0u);
	std::stable_sort(Order.begin(), Order.end(), [&Places](uint32 A, uint32 B) { return Places[A] < Places[B]; });
	return Order;
}
} // namespace

void FTerraportMeshPart::Build(const terraport::SegmentMesh& Mesh, terraport::ByteSpan Payload,
	const std::vector<terraport::Region>& Regions, ETerraportVertexColours Coding, FTerraportPixels& Pixels, bool& bUnread)
{
	const int32 Count = int32(Mesh.vertexCount);
	Positions.SetNumUninitialized(Count);
	Normals.SetNumUninitialized(Count);
	Bounds = FBox3f(ForceInit);
	for (int32 Vertex = 0; Vertex < Count; ++Vertex)
	{
		float Unreal[3];
		TerraportAxes::PointToUnreal(&Mesh.positions[3 * std::size_t(Vertex)], Unreal);
		Positions[Vertex] = FVector3f(Unreal[0], Unreal[1], Unreal[2]);
		Bounds += Positions[Vertex];
		TerraportAxes::NormalToUnreal(&Mesh.normals[3 * std::size_t(Vertex)], Unreal);
		Normals[Vertex] = FVector3f(Unreal[0], Unreal[1], Unreal[2]);
	}
	Pixels = TerraportTexture::Decode(Mesh.image, Payload);
	bUnread = Pixels.IsEmpty() && Mesh.image.kind != terraport::ImageKind::None;
	Uvs.Reset();
	Colours.Reset();
	if (bUnread)
	{
		const FColor Colour = Coded(MeanColourOf(Mesh, Regions), Coding);
		for (int32 Vertex = 0; Vertex < Count; ++Vertex)
		{
			Colours.Add(Colour);
		}
	}
	for (std::size_t At = 0; !bUnread && At < Mesh.uvs.size(); At += 2)
	{
		Uvs.Add(FVector2f(Mesh.uvs[At], Mesh.uvs[At + 1]));
	}
	for (std::size_t At = 0; At < Mesh.colours.size(); At += 3)
	{
		Colours.Add(Coded(FColor(Mesh.colours[At], Mesh.colours[At + 1], Mesh.colours[At + 2], 255), Coding));
	}
	// Corners keep their order: see TerraportAxes.h.
	Indices.SetNumUninitialized(int32(Mesh.indices.size()));
	std::copy(Mesh.indices.begin(), Mesh.indices.end(), Indices.GetData());
}

FTerraportMeshPart FTerraportMeshPart::Cut(const std::vector<uint32>& Faces) const
{
	FTerraportMeshPart Part;
	// The vertices that are used, each once, ascending.
	std::vector<uint32> Corners;
	for (const uint32 Face : Faces)
	{
		const uint32* First = Indices.GetData() + 3 * std::size_t(Face);
		Corners.insert(Corners.end(), First, First + 3);
	}
	std::vector<uint32> Used = Corners;
	std::sort(Used.begin(), Used.end());
	Used.erase(std::unique(Used.begin(), Used.end()), Used.end());
	for (const uint32 Vertex : Used)
	{
		const int32 At = int32(Vertex);
		Part.Positions.Add(Positions[At]);
		Part.Normals.Add(Normals[At]);
		Part.Bounds += Positions[At];
		if (Colours.Num() > 0)
		{
			Part.Colours.Add(Colours[At]);
		}
		if (Uvs.Num() > 0)
		{
			Part.Uvs.Add(Uvs[At]);
		}
	}
	for (const uint32 Vertex : Corners)
	{
		Part.Indices.Add(uint32(std::lower_bound(Used.begin(), Used.end(), Vertex) - Used.begin()));
	}
	return Part;
}

TSharedRef<FTerraportBase, ESPMode::ThreadSafe> FTerraportBase::Build(
	const terraport::Scene& Scene, ETerraportVertexColours Coding)
{
	TSharedRef<FTerraportBase, ESPMode::ThreadSafe> Base = MakeShared<FTerraportBase, ESPMode::ThreadSafe>();
	FTerraportMeshPart Whole;
	Whole.Build(Scene.base, *Scene.basePayload, Scene.regions, Coding, Base->Pixels, Base->bUnread);
	Base->Ground = std::make_shared<const terraport::GroundMesh>(Scene.base);
	Base->PushBackM = Scene.deviationM;
	const std::vector<uint32> Order = OrderOnGround(Scene.base);
	for (std::size_t First = 0; First < Order.size(); First += BlockFaces)
	{
		Base->Blocks.emplace_back();
		FBlock& Block = Base->Blocks.back();
		Block.Faces.assign(
			Order.begin() + std::ptrdiff_t(First), Order.begin() + std::ptrdiff_t(std::min(First + BlockFaces, Order.size())));
		Block.Part = Whole.Cut(Block.Faces);
	}
	return Base;
}
