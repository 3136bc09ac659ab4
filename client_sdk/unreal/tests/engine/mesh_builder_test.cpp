#include "TerraportDynamicBackend.h"
#include "TerraportMeshBuilder.h"
#include "meshes.h"

#include "Components/DynamicMeshComponent.h"
#include "GameFramework/Actor.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <vector>

TEST_CASE("a part has the mesh's places, colours and corners")
{
	terraport::SegmentMesh Mesh;
	MakeGrid(3, Mesh);
	FTerraportMeshPart Part;
	TerraportMeshBuilder::BuildPart(Mesh, ETerraportVertexColours::Srgb, Part);
	REQUIRE(Part.Positions.Num() == 16);
	CHECK(Part.Positions[15] == FVector3f(300.0f, 300.0f, 0.0f));
	CHECK(Part.Normals[7] == FVector3f(0.0f, 0.0f, 1.0f));
	CHECK(Part.Uvs.Num() == 0);
	CHECK(Part.Bounds.Max == FVector3f(300.0f, 300.0f, 0.0f));
	for (int32 Vertex = 0; Vertex < 16; ++Vertex)
	{
		CHECK(Part.Colours[Vertex].R == Mesh.colours[4 * std::size_t(Vertex)]);
	}
	TerraportMeshBuilder::BuildPart(Mesh, ETerraportVertexColours::Linear, Part);
	for (int32 Vertex = 0; Vertex < 16; ++Vertex)
	{
		const double Share = Mesh.colours[4 * std::size_t(Vertex)] / 255.0;
		const double Linear = Share <= 0.04045 ? Share / 12.92 : std::pow((Share + 0.055) / 1.055, 2.4);
		CHECK(int(Part.Colours[Vertex].R) == int(Linear * 255.0 + 0.5));
	}
}

TEST_CASE("a cut part draws the same faces with its own vertices alone")
{
	terraport::SegmentMesh Mesh;
	MakeGrid(5, Mesh);
	FTerraportMeshPart Whole, Part;
	TerraportMeshBuilder::BuildPart(Mesh, ETerraportVertexColours::Srgb, Whole);
	TerraportMeshBuilder::CutPart(Whole, 7, 9, Part);
	REQUIRE(Part.Indices.Num() == 27);
	CHECK(Part.Positions.Num() < Whole.Positions.Num());
	CHECK(Part.Colours.Num() == Part.Positions.Num());
	for (int32 Index = 0; Index < 27; ++Index)
	{
		const FVector3f& Expected = Whole.Positions[int32(Whole.Indices[21 + Index])];
		CHECK(Part.Positions[int32(Part.Indices[Index])] == Expected);
	}
}

TEST_CASE("ground whose image cannot be read has the mean colour of its regions, in the material's coding, and says so")
{
	std::vector<terraport::RegionFacts> Regions(3);
	Regions[0].meanColour = terraport::Vec3{100.0, 0.0, 0.0};
	Regions[0].areaM2 = 1.0;
	Regions[1].meanColour = terraport::Vec3{200.0, 40.0, 0.0};
	Regions[1].areaM2 = 3.0;
	terraport::SegmentMesh Mesh;
	MakeGrid(1, Mesh);
	CHECK(int(TerraportMeshBuilder::MeanColourOf(Mesh, {}).R) == 200);
	CHECK(int(TerraportMeshBuilder::MeanColourOf(Mesh, Regions).R) == 175);
	CHECK(int(TerraportMeshBuilder::MeanColourOf(Mesh, Regions).G) == 30);
	Mesh.hasRegionIds = true;
	REQUIRE(Mesh.regionIds.resize(4));
	const std::uint16_t Ids[4] = {0, 0, 1, 2};
	std::copy(Ids, Ids + 4, Mesh.regionIds.data());
	CHECK(int(TerraportMeshBuilder::MeanColourOf(Mesh, Regions).R) == 133);
	Mesh.hasColours = false;
	Mesh.image.type = terraport::ImageType::Ktx2;
	FTerraportSegmentData Data;
	const FTerraportDynamicBackend Backend;
	Data.Build(Mesh, terraport::ByteSpan{}, Backend, ETerraportVertexColours::Srgb, Regions);
	CHECK(Data.Unread == terraport::ImageType::Ktx2);
	REQUIRE(Data.Part.Colours.Num() == 4);
	CHECK(int(Data.Part.Colours[3].R) == 133);
	CHECK(Data.Part.Uvs.Num() == 0);
	Data.Build(Mesh, terraport::ByteSpan{}, Backend, ETerraportVertexColours::Linear, Regions);
	// Level 133 of sRGB is .235 of the light.
	CHECK(int(Data.Part.Colours[3].R) == 60);
	Mesh.image.type = terraport::ImageType::None;
	Data.Build(Mesh, terraport::ByteSpan{}, Backend, ETerraportVertexColours::Srgb, Regions);
	CHECK(Data.Unread == terraport::ImageType::None);
	CHECK(Data.Part.Colours.Num() == 0);
}

TEST_CASE("the dynamic backend keeps faces that three share an edge with")
{
	FTerraportMeshPart Part;
	for (const FVector3f& Position :
		{FVector3f(0, 0, 0), FVector3f(0, 0, 1), FVector3f(1, 0, 0), FVector3f(0, 1, 0), FVector3f(-1, 0, 0)})
	{
		Part.Positions.Add(Position);
		Part.Normals.Add(FVector3f(0, 0, 1));
	}
	// Three faces at the edge 0-1, and one without area.
	for (const uint32 Corner : {0u, 1u, 2u, 0u, 1u, 3u, 0u, 1u, 4u, 2u, 2u, 3u})
	{
		Part.Indices.Add(Corner);
	}
	FTerraportDynamicBackend Backend;
	const TUniquePtr<FTerraportPreparedMesh> Prepared = Backend.Prepare(Part);
	AActor Actor;
	const FTerraportPiece Created = Backend.Create(Actor, *Prepared, nullptr, FTerraportMeshSettings());
	UDynamicMeshComponent* Component = static_cast<UDynamicMeshComponent*>(Created.Component);
	REQUIRE(Component != nullptr);
	CHECK(Component->StubMesh.StubTriangles.size() == 3);
	CHECK(Component->StubMesh.StubVertices.size() == 8);
	CHECK(Component->StubMesh.Attributes()->PrimaryNormals()->StubElements.size() == 8);
	CHECK(Component->StubMesh.Attributes()->PrimaryColors()->StubTriangles.size() == 3);
	CHECK_FALSE(Component->bStubVisible);
	Backend.SetShown(Created, true);
	CHECK(Component->bStubVisible);
}
