#include "TerraportDynamicBackend.h"
#include "TerraportMeshBuilder.h"
#include "meshes.h"

#include "Components/DynamicMeshComponent.h"
#include "GameFramework/Actor.h"

#include <doctest/doctest.h>

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
		const uint16 Code = Mesh.coloursLinear16[4 * std::size_t(Vertex)];
		CHECK(Part.Colours[Vertex].R == terraport::srgbOfLinear16(Code));
	}
	TerraportMeshBuilder::BuildPart(Mesh, ETerraportVertexColours::Linear, Part);
	for (int32 Vertex = 0; Vertex < 16; ++Vertex)
	{
		const uint16 Code = Mesh.coloursLinear16[4 * std::size_t(Vertex)];
		CHECK(int(Part.Colours[Vertex].R) == int(double(Code) / 65535.0 * 255.0 + 0.5));
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
