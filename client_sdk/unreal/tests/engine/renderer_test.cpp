#include "TerraportBaseOrder.h"
#include "TerraportRenderer.h"
#include "meshes.h"

#include "Components/PrimitiveComponent.h"
#include "Engine/Texture2D.h"
#include "GameFramework/Actor.h"
#include "Materials/Material.h"
#include "Materials/MaterialInstanceDynamic.h"
#include "Misc/EngineVersionComparison.h"

#include <doctest/doctest.h>

#include <memory>
#include <set>
#include <vector>

namespace
{
constexpr uint32 BlockFaces = 40;

class FFakeMesh final : public FTerraportPreparedMesh
{
public:
	FTerraportMeshPart Part;
};

class FFakeComponent final : public UPrimitiveComponent
{
public:
	FTerraportMeshPart Part;
	bool bShown = false;
};

/// Remembers every component that it made.
class FFakeBackend final : public ITerraportMeshBackend
{
public:
	virtual TUniquePtr<FTerraportPreparedMesh> Prepare(const FTerraportMeshPart& Part) const override
	{
		TUniquePtr<FFakeMesh> Mesh = MakeUnique<FFakeMesh>();
		Mesh->Part = Part;
		return Mesh;
	}
	virtual FTerraportPiece Create(
		AActor&, FTerraportPreparedMesh& Prepared, UMaterialInterface* Material, const FTerraportMeshSettings&) override
	{
		Components.push_back(std::make_unique<FFakeComponent>());
		Components.back()->Part = static_cast<FFakeMesh&>(Prepared).Part;
		Components.back()->SetMaterial(0, Material);
		return FTerraportPiece{Components.back().get(), int32(Components.size())};
	}
	virtual void SetShown(const FTerraportPiece& Piece, bool bShown) override
	{
		static_cast<FFakeComponent*>(Piece.Component)->bShown = bShown;
	}
	virtual void Remove(const FTerraportPiece& Piece) override { CHECK(Removed.insert(Piece.Index).second); }
	virtual SIZE_T BytesOf(int32 Vertices, int32 Indices) const override { return SIZE_T(Vertices + Indices); }

	/// Centres of the faces that are drawn, each as often as it is drawn.
	std::multiset<std::pair<int, int>> Drawn() const
	{
		std::multiset<std::pair<int, int>> Faces;
		for (const auto& Component : Components)
		{
			for (int32 First = 0; Component->bShown && IsValid(Component.get()) && First < Component->Part.Indices.Num();
				First += 3)
			{
				FVector3f Sum;
				for (int32 Corner = 0; Corner < 3; ++Corner)
				{
					Sum += Component->Part.Positions[int32(Component->Part.Indices[First + Corner])];
				}
				Faces.insert({int(Sum.X), int(Sum.Y)});
			}
		}
		return Faces;
	}
	int Alive() const
	{
		int Count = 0;
		for (const auto& Component : Components)
		{
			Count += IsValid(Component.get()) ? 1 : 0;
		}
		return Count;
	}
	std::vector<std::unique_ptr<FFakeComponent>> Components;
	std::set<int32> Removed;
};

class FKeeper final : public ITerraportKeeper
{
public:
	virtual void Keep(UObject* Object) override { CHECK(Kept.insert(Object).second); }
	virtual void Release(UObject* Object) override { CHECK(Kept.erase(Object) == 1); }
	std::set<UObject*> Kept;
};

/// A scene of 12 x 12 squares whose base is drawn, and what a test does with it.
struct FStand
{
	FStand()
	{
		MakeScene(12, *Files);
		REQUIRE(TerraportBaseOrder::Reorder(*Files, BlockFaces));
		Materials.Colour = Materials.Texture = Materials.BaseColour = Materials.BaseTexture = &Material;
		Renderer = std::make_unique<FTerraportRenderer>(Actor, Keeper, Backend, Materials, FTerraportMeshSettings());
		BeginBase();
	}
	void BeginBase()
	{
		Renderer->SetBase(FTerraportBase::Build(*Files, BlockFaces, ETerraportVertexColours::Srgb));
		StartBase();
	}
	void StartBase();
	void Upload(std::uint32_t Segment)
	{
		terraport::SegmentMesh Mesh;
		MakeGrid(2, Mesh);
		auto Data = std::make_unique<FTerraportSegmentData>();
		Data->Build(Mesh, terraport::ByteSpan{}, *Backend, ETerraportVertexColours::Srgb, {});
		Mesh.engineData = std::move(Data);
		CHECK(Renderer->upload(Segment, Mesh, terraport::ByteSpan{}) == terraport::UploadState::Done);
	}
	void Prepare(const std::vector<std::uint8_t>& Mask);
	terraport::SceneSwap SwapOf(const std::vector<std::uint8_t>& Mask) const
	{
		terraport::SceneSwap Swap;
		for (std::uint32_t First = 0; First < Files->base.faceCount; First += BlockFaces)
		{
			Swap.baseBlocks.push_back({First, std::min(BlockFaces, Files->base.faceCount - First)});
		}
		Swap.baseHidden = {Mask.data(), std::uint32_t(Mask.size())};
		return Swap;
	}
	/// What the base must draw under a mask.
	std::multiset<std::pair<int, int>> Expected(const std::vector<std::uint8_t>& Mask) const
	{
		std::vector<float> Positions(3 * std::size_t(Files->base.vertexCount));
		Files->base.writePositions(Positions.data());
		std::multiset<std::pair<int, int>> Faces;
		for (std::size_t Face = 0; Face < Files->base.faceCount; ++Face)
		{
			float X = 0.0f, Y = 0.0f;
			for (std::size_t Corner = 0; Corner < 3; ++Corner)
			{
				const float* At = Positions.data() + 3 * std::size_t(Files->base.indices[3 * Face + Corner]);
				X += 100.0f * At[0];
				Y += 100.0f * At[2];
			}
			if (Mask.empty() || Mask[Face] == 0)
			{
				Faces.insert({int(X), int(Y)});
			}
		}
		return Faces;
	}
	void RunFrames(int Count)
	{
		for (int Frame = 0; Frame < Count; ++Frame)
		{
			++GFrameCounter;
			Renderer->Step(0.0);
		}
	}

	std::shared_ptr<terraport::SceneFiles> Files = std::make_shared<terraport::SceneFiles>();
	AActor Actor;
	UMaterial Material;
	FKeeper Keeper;
	TSharedRef<FFakeBackend, ESPMode::ThreadSafe> Backend = MakeShared<FFakeBackend, ESPMode::ThreadSafe>();
	FTerraportMaterials Materials;
	std::unique_ptr<FTerraportRenderer> Renderer;
};

void FStand::StartBase()
{
	Renderer->beginBase(*Files);
	RunFrames(int(Files->base.faceCount / BlockFaces) + 1);
}

void FStand::Prepare(const std::vector<std::uint8_t>& Mask)
{
	for (const terraport::FaceRange& Block : SwapOf(Mask).baseBlocks)
	{
		Renderer->prepareBase(Block, {Mask.data(), std::uint32_t(Mask.size())});
	}
}

std::vector<std::uint8_t> MaskOf(std::size_t Faces, std::size_t Every)
{
	std::vector<std::uint8_t> Mask(Faces, 0);
	for (std::size_t Face = 0; Face < Faces; Face += Every)
	{
		Mask[Face] = 1;
	}
	return Mask;
}
} // namespace

TEST_CASE("the base is drawn whole, each face once, and with its push")
{
	FStand Stand;
	CHECK(Stand.Renderer->isBaseReady());
	CHECK(Stand.Backend->Drawn() == Stand.Expected({}));
	const UMaterialInstanceDynamic* Instance =
		static_cast<UMaterialInstanceDynamic*>(Stand.Backend->Components.front()->StubMaterial);
	REQUIRE(Instance != nullptr);
	CHECK(Instance->StubScalar == 25.0f);
}

TEST_CASE("preparing changes nothing of what is drawn; the swap changes all of it at once")
{
	FStand Stand;
	const std::vector<std::uint8_t> Mask = MaskOf(Stand.Files->base.faceCount, 3);
	Stand.Upload(4);
	Stand.Upload(5);
	Stand.Prepare(Mask);
	CHECK(Stand.Backend->Drawn() == Stand.Expected({}));
	terraport::SceneSwap Swap = Stand.SwapOf(Mask);
	Swap.shown = {4};
	const std::size_t CountBefore = Stand.Backend->Components.size();
	Stand.Renderer->swap(Swap);
	CHECK(Stand.Backend->Components.size() == CountBefore);
	auto Expected = Stand.Expected(Mask);
	FFakeBackend Segment;
	Segment.Components.push_back(std::make_unique<FFakeComponent>());
	TerraportMeshBuilder::BuildPart(
		[] {
			static terraport::SegmentMesh Mesh;
			MakeGrid(2, Mesh);
			return std::cref(Mesh);
		}(),
		ETerraportVertexColours::Srgb, Segment.Components.back()->Part);
	Segment.Components.back()->bShown = true;
	for (const auto& Face : Segment.Drawn())
	{
		Expected.insert(Face);
	}
	CHECK(Stand.Backend->Drawn() == Expected);
}

TEST_CASE("a block that was prepared twice shows the newer mask, and one with every face hidden shows nothing")
{
	FStand Stand;
	const std::size_t Faces = Stand.Files->base.faceCount;
	Stand.Prepare(MaskOf(Faces, 2));
	const std::vector<std::uint8_t> All(Faces, 1);
	Stand.Prepare(All);
	Stand.Renderer->swap(Stand.SwapOf(All));
	CHECK(Stand.Backend->Drawn().empty());
	const std::vector<std::uint8_t> None(Faces, 0);
	Stand.Prepare(None);
	Stand.Renderer->swap(Stand.SwapOf(None));
	CHECK(Stand.Backend->Drawn() == Stand.Expected({}));
}

TEST_CASE("a new version's base appears at once, when all of it is made; until then the old one is drawn")
{
	FStand Stand;
	const std::vector<std::uint8_t> Mask = MaskOf(Stand.Files->base.faceCount, 4);
	Stand.Upload(6);
	Stand.Prepare(Mask);
	terraport::SceneSwap Swap = Stand.SwapOf(Mask);
	Swap.shown = {6};
	Stand.Renderer->swap(Swap);
	const auto Before = Stand.Backend->Drawn();
	Stand.Renderer->SetBase(FTerraportBase::Build(*Stand.Files, BlockFaces, ETerraportVertexColours::Srgb));
	Stand.Renderer->beginBase(*Stand.Files);
	for (std::uint32_t Block = 0; !Stand.Renderer->isBaseReady(); ++Block)
	{
		REQUIRE(Block < Stand.Files->base.faceCount / BlockFaces + 1);
		CHECK(Stand.Backend->Drawn() == Before);
		Stand.RunFrames(1);
	}
	CHECK(Stand.Backend->Drawn() == Stand.Expected({}));
}

TEST_CASE("a segment is drawable in the frame after it was made, and gone when it is freed")
{
	FStand Stand;
	Stand.Upload(9);
	CHECK_FALSE(Stand.Renderer->isDrawable(9));
	++GFrameCounter;
	CHECK(Stand.Renderer->isDrawable(9));
	CHECK_FALSE(Stand.Renderer->isDrawable(10));
	const int Alive = Stand.Backend->Alive();
	Stand.Renderer->free(9);
	CHECK_FALSE(Stand.Renderer->isDrawable(9));
	Stand.RunFrames(2);
	CHECK(Stand.Backend->Alive() == Alive - 1);
}

TEST_CASE("a texture is made in a step of its own, and a payload that was not built fails")
{
	FStand Stand;
	terraport::SegmentMesh Mesh;
	MakeGrid(2, Mesh);
	CHECK(Stand.Renderer->upload(1, Mesh, terraport::ByteSpan{}) == terraport::UploadState::Failed);
	auto Data = std::make_unique<FTerraportSegmentData>();
	Data->Build(Mesh, terraport::ByteSpan{}, *Stand.Backend, ETerraportVertexColours::Srgb, {});
	Data->Pixels.Width = Data->Pixels.Height = 2;
	Data->Pixels.Mips.resize(1);
	Data->Pixels.Mips[0].SetNumUninitialized(16);
	TerraportTexture::MakeMips(Data->Pixels);
	Mesh.engineData = std::move(Data);
	CHECK(Stand.Renderer->upload(1, Mesh, terraport::ByteSpan{}) == terraport::UploadState::More);
	CHECK(Stand.Renderer->upload(1, Mesh, terraport::ByteSpan{}) == terraport::UploadState::Done);
	const UMaterialInstanceDynamic* Instance =
		static_cast<UMaterialInstanceDynamic*>(Stand.Backend->Components.back()->StubMaterial);
	REQUIRE(Instance != nullptr);
	REQUIRE(Instance->StubTexture != nullptr);
	UTexture* const Texture = Instance->StubTexture;
	CHECK(Texture->bStubUpdated);
	CHECK_FALSE(Texture->bStubReleased);
	// Its memory goes with the segment, not with the next collection.
	Stand.Renderer->free(1);
	Stand.RunFrames(2);
	CHECK(Texture->bStubReleased);
	CHECK(Stand.Keeper.Kept.count(Texture) == 0);
}

TEST_CASE("an image that was not read is told of once, and its ground is drawn")
{
	FStand Stand;
	CHECK(Stand.Renderer->TakeUnread() == terraport::ImageType::None);
	terraport::SegmentMesh Mesh;
	MakeGrid(2, Mesh);
	Mesh.image.type = terraport::ImageType::Webp;
	auto Data = std::make_unique<FTerraportSegmentData>();
	Data->Build(Mesh, terraport::ByteSpan{}, *Stand.Backend, ETerraportVertexColours::Srgb, {});
	Mesh.engineData = std::move(Data);
	CHECK(Stand.Renderer->upload(3, Mesh, terraport::ByteSpan{}) == terraport::UploadState::Done);
	CHECK(Stand.Renderer->TakeUnread() == terraport::ImageType::Webp);
	CHECK(Stand.Renderer->TakeUnread() == terraport::ImageType::None);
	CHECK(Stand.Backend->Components.back()->StubMaterial == &Stand.Material);
}

TEST_CASE("pieces are given back to the backend, each once, before their component goes")
{
	FStand Stand;
	Stand.Upload(1);
	Stand.Upload(2);
	const std::size_t Made = Stand.Backend->Components.size();
	Stand.Renderer.reset();
	CHECK(Stand.Backend->Removed.size() == Made);
}

TEST_CASE("components that the collector has found are left to it")
{
	FStand Stand;
	Stand.Upload(1);
	FFakeComponent& Component = *Stand.Backend->Components.back();
	Component.bStubUnreachable = true;
	Stand.Renderer.reset();
	CHECK_FALSE(Component.bStubDestroyed);
	CHECK(Stand.Keeper.Kept.empty());
}

TEST_CASE("everything that was kept from the collector is let go in the end")
{
	FStand Stand;
	Stand.Upload(1);
	Stand.Upload(2);
	const std::vector<std::uint8_t> Mask = MaskOf(Stand.Files->base.faceCount, 2);
	Stand.Prepare(Mask);
	terraport::SceneSwap Swap = Stand.SwapOf(Mask);
	Swap.shown = {1};
	Stand.Renderer->swap(Swap);
	Stand.BeginBase();
	CHECK_FALSE(Stand.Keeper.Kept.empty());
	Stand.Renderer.reset();
	CHECK(Stand.Keeper.Kept.empty());
	CHECK(Stand.Backend->Alive() == 0);
}
