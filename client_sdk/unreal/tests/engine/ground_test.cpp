// Packed pieces in components: how many, how large, drawn when, and that nothing stays behind.
#include "TerraportGroundBackend.h"
#include "TerraportGroundComponent.h"
#include "TerraportGroundPiece.h"
#include "TerraportMeshBuilder.h"
#include "meshes.h"

#include "GameFramework/Actor.h"
#include "PrimitiveSceneProxy.h"
#include "SceneManagement.h"

#include <doctest/doctest.h>

#include <memory>
#include <set>
#include <vector>

namespace
{
FTerraportMeshPart GridAt(std::uint32_t Side, float X, float Y)
{
	terraport::SegmentMesh Mesh;
	MakeGrid(Side, Mesh);
	FTerraportMeshPart Part;
	TerraportMeshBuilder::BuildPart(Mesh, ETerraportVertexColours::Srgb, Part);
	Part.Bounds = FBox3f(ForceInit);
	for (FVector3f& Position : Part.Positions)
	{
		Position += FVector3f(X, Y, 0.0f);
		Part.Bounds += Position;
	}
	return Part;
}

struct FGround
{
	FTerraportPiece Add(const FTerraportMeshPart& Part)
	{
		const TUniquePtr<FTerraportPreparedMesh> Prepared = Backend.Prepare(Part);
		return Backend.Create(Actor, *Prepared, nullptr, FTerraportMeshSettings());
	}
	FTerraportGroundBackend Backend;
	AActor Actor;
};

/// Triangles that a view meets in a component.
int64 TrianglesIn(UPrimitiveComponent& Component, const FSceneView& View)
{
	TArray<const FSceneView*> Views;
	Views.Add(&View);
	FMeshElementCollector Collector;
	const std::unique_ptr<FPrimitiveSceneProxy> Proxy(Component.CreateSceneProxy());
	Proxy->GetDynamicMeshElements(Views, FSceneViewFamily(), 1, Collector);
	int64 Triangles = 0;
	for (const auto& Mesh : Collector.StubMeshes)
	{
		Triangles += Mesh.second->Elements[0].NumPrimitives;
	}
	return Triangles;
}
} // namespace

TEST_CASE("a piece is packed: 28 bytes a vertex and 6 a face, on the graphics alone")
{
	const FTerraportMeshPart Part = GridAt(20, 0.0f, 0.0f);
	const int64 Before = FRenderResource::StubGpuBytes;
	FGround Ground;
	const FTerraportPiece Piece = Ground.Add(Part);
	const int64 Expected = 28 * 21 * 21 + 6 * 2 * 20 * 20;
	CHECK(FRenderResource::StubGpuBytes - Before == Expected);
	CHECK(int64(Ground.Backend.BytesOf(21 * 21, 3 * 2 * 20 * 20)) == Expected);
	const auto* Component = static_cast<UTerraportGroundComponent*>(Piece.Component);
	CHECK(Component->GetGpuBytes() == Expected);
	CHECK(Component->bStubRegistered);
	Ground.Backend.Remove(Piece);
	CHECK(FRenderResource::StubGpuBytes == Before);
	CHECK(Component->GetGpuBytes() == 0);
}

TEST_CASE("a textured piece without colours has none on the graphics, and one of many vertices has long corners")
{
	FTerraportMeshPart Part = GridAt(2, 0.0f, 0.0f);
	Part.Colours.Reset();
	Part.Uvs.SetNumUninitialized(Part.Positions.Num());
	CHECK(FTerraportGroundPiece(Part).GpuBytes() == 24 * 9 + 6 * 8);
	const FTerraportMeshPart Large = GridAt(256, 0.0f, 0.0f);
	CHECK(FTerraportGroundPiece(Large).GpuBytes() == 28 * 257 * 257 + 12 * 2 * 256 * 256);
}

TEST_CASE("sixteen neighbours share a component, the next has another, and so has one that is far away")
{
	FGround Ground;
	std::vector<FTerraportPiece> Pieces;
	for (int At = 0; At < 17; ++At)
	{
		Pieces.push_back(Ground.Add(GridAt(2, 200.0f * float(At % 4), 200.0f * float(At / 4))));
	}
	std::set<UPrimitiveComponent*> Components;
	for (const FTerraportPiece& Piece : Pieces)
	{
		Components.insert(Piece.Component);
	}
	CHECK(Components.size() == 2);
	CHECK(Pieces[0].Component == Pieces[15].Component);
	const FTerraportPiece Far = Ground.Add(GridAt(2, 1.0e5f, 0.0f));
	CHECK(Components.count(Far.Component) == 0);
	// Room is used again, by whoever is near.
	Ground.Backend.Remove(Pieces[7]);
	const FTerraportPiece Near = Ground.Add(GridAt(2, 600.0f, 200.0f));
	CHECK(Near.Component == Pieces[7].Component);
	CHECK(Near.Index == Pieces[7].Index);
	// A component that has gone is not asked for room.
	Ground.Backend.Remove(Far);
	Far.Component->DestroyComponent();
	CHECK(Ground.Add(GridAt(2, 1.0e5f, 0.0f)).Component != Far.Component);
}

TEST_CASE("a piece is drawn while it is shown and in sight, and for shadows wherever it is; a new proxy draws it as well")
{
	FGround Ground;
	const FTerraportPiece Left = Ground.Add(GridAt(3, 0.0f, 0.0f));
	const FTerraportPiece Right = Ground.Add(GridAt(2, 1000.0f, 0.0f));
	REQUIRE(Left.Component == Right.Component);
	FSceneView View;
	CHECK(TrianglesIn(*Left.Component, View) == 0);
	Ground.Backend.SetShown(Left, true);
	CHECK(TrianglesIn(*Left.Component, View) == 18);
	Ground.Backend.SetShown(Right, true);
	CHECK(TrianglesIn(*Left.Component, View) == 26);
	CHECK(static_cast<UTerraportGroundComponent*>(Left.Component)->GetShownTriangles() == 26);
	View.ViewFrustum.StubLeastX = 900.0;
	CHECK(TrianglesIn(*Left.Component, View) == 8);
	const FConvexVolume Shadow;
	View.StubShadow = &Shadow;
	CHECK(TrianglesIn(*Left.Component, View) == 26);
	Ground.Backend.SetShown(Left, false);
	CHECK(TrianglesIn(*Left.Component, View) == 8);
	Ground.Backend.Remove(Right);
	CHECK(TrianglesIn(*Left.Component, View) == 0);
}

TEST_CASE("the box is that of the pieces that are there")
{
	FGround Ground;
	const FTerraportPiece Left = Ground.Add(GridAt(3, 0.0f, 0.0f));
	const FTerraportPiece Right = Ground.Add(GridAt(2, 1000.0f, 500.0f));
	const auto* Component = static_cast<UTerraportGroundComponent*>(Left.Component);
	CHECK(Component->GetPieceBounds().Max == FVector(1200.0, 700.0, 0.0));
	const int Updates = Component->StubBoundsUpdates;
	Ground.Backend.Remove(Right);
	CHECK(Component->GetPieceBounds().Max == FVector(300.0, 300.0, 0.0));
	CHECK(Component->StubBoundsUpdates == Updates + 1);
}

TEST_CASE("a component that is destroyed with its level gives its pieces back")
{
	const int64 Before = FRenderResource::StubGpuBytes;
	FGround Ground;
	const FTerraportPiece Piece = Ground.Add(GridAt(2, 0.0f, 0.0f));
	CHECK(FRenderResource::StubGpuBytes > Before);
	Piece.Component->DestroyComponent();
	CHECK(FRenderResource::StubGpuBytes == Before);
	Ground.Backend.Remove(Piece);
}
