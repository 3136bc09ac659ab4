#include "TerraportRenderer.h"

#include "Components/PrimitiveComponent.h"
#include "Engine/Texture2D.h"
#include "GameFramework/Actor.h"
#include "HAL/PlatformTime.h"
#include "Materials/MaterialInstanceDynamic.h"
#include "Materials/MaterialInterface.h"

#include <algorithm>
#include <utility>

FTerraportRenderer::FTerraportRenderer(AActor& InOwner, ITerraportKeeper& InKeeper,
	TSharedRef<ITerraportMeshBackend, ESPMode::ThreadSafe> InBackend, const FTerraportMaterials& InMaterials,
	const FTerraportMeshSettings& InSettings)
	: Owner(InOwner), Keeper(InKeeper), Backend(InBackend), Materials(InMaterials), Settings(InSettings)
{
}

FTerraportRenderer::~FTerraportRenderer()
{
	for (auto& Entry : Segments)
	{
		Destroy(Entry.second);
	}
	for (FBlock& Block : Blocks)
	{
		Destroy(Block.Front);
		Destroy(Block.Back);
	}
	for (FDrawable& Drawable : Leaving)
	{
		Destroy(Drawable);
	}
	for (FDrawable& Drawable : ToDestroy)
	{
		Destroy(Drawable);
	}
	if (BaseTexture != nullptr)
	{
		ReleaseTexture(BaseTexture);
	}
	if (BaseMaterial != nullptr)
	{
		Keeper.Release(BaseMaterial);
	}
}

terraport::ImageType FTerraportRenderer::TakeUnread()
{
	const terraport::ImageType Last = Unread;
	Unread = terraport::ImageType::None;
	return Last;
}

void FTerraportRenderer::SetBase(TSharedRef<FTerraportBase, ESPMode::ThreadSafe> InBase)
{
	Base = InBase;
	if (InBase->Unread != terraport::ImageType::None)
	{
		Unread = InBase->Unread;
	}
}

void FTerraportRenderer::Step(double EndS)
{
	bool bFirst = true;
	while (bFirst || FPlatformTime::Seconds() < EndS)
	{
		bFirst = false;
		if (Base.IsValid() && NextBlock < Blocks.size())
		{
			FBlock& Block = Blocks[NextBlock];
			if (!Block.bHasFront)
			{
				MakeBlock(NextBlock, nullptr, Block.Front);
				Block.bHasFront = true;
			}
			++NextBlock;
			if (NextBlock == Blocks.size())
			{
				ShowBase();
			}
		}
		else if (!ToDestroy.empty())
		{
			Destroy(ToDestroy.back());
			ToDestroy.pop_back();
		}
		else
		{
			return;
		}
	}
}

terraport::UploadState FTerraportRenderer::upload(
	std::uint32_t Segment, const terraport::SegmentMesh& Mesh, terraport::ByteSpan)
{
	FTerraportSegmentData* Data = static_cast<FTerraportSegmentData*>(Mesh.engineData.get());
	if (Data == nullptr || !Data->Prepared.IsValid())
	{
		return terraport::UploadState::Failed;
	}
	if (Data->Unread != terraport::ImageType::None)
	{
		Unread = Data->Unread;
	}
	FDrawable& Drawable = Segments[Segment];
	if (!Data->Pixels.IsEmpty())
	{
		// A slice of its own: copying a megapixel with its mips takes about as long as a mesh.
		Drawable.Texture = TerraportTexture::MakeTexture(Data->Pixels);
		Data->Pixels = FTerraportPixels();
		if (Drawable.Texture != nullptr)
		{
			Keeper.Keep(Drawable.Texture);
			return terraport::UploadState::More;
		}
	}
	UMaterialInterface* Material =
		Drawable.Texture != nullptr ? Textured(Materials.Texture, Drawable.Texture) : Materials.Colour;
	const bool bCreated = Make(Drawable, *Data->Prepared, Material);
	Data->Prepared.Reset();
	if (!bCreated)
	{
		Destroy(Drawable);
		Segments.erase(Segment);
		return terraport::UploadState::Failed;
	}
	return terraport::UploadState::Done;
}

bool FTerraportRenderer::isDrawable(std::uint32_t Segment)
{
	const auto Entry = Segments.find(Segment);
	return Entry != Segments.end() && Entry->second.CreatedInFrame < GFrameCounter;
}

void FTerraportRenderer::free(std::uint32_t Segment)
{
	const auto Entry = Segments.find(Segment);
	if (Entry != Segments.end())
	{
		Discard(Entry->second);
		Segments.erase(Entry);
	}
}

std::size_t FTerraportRenderer::gpuBytesOf(const terraport::SegmentMesh& Mesh) const
{
	return std::size_t(Backend->BytesOf(int32(Mesh.vertexCount), int32(Mesh.indices.size()))) + Mesh.image.gpuBytes();
}

void FTerraportRenderer::swap(const terraport::SceneSwap& Change)
{
	for (const std::uint32_t Segment : Change.hidden)
	{
		const auto Entry = Segments.find(Segment);
		if (Entry != Segments.end())
		{
			Show(Entry->second, false);
		}
	}
	for (const std::uint32_t Segment : Change.shown)
	{
		const auto Entry = Segments.find(Segment);
		if (Entry != Segments.end())
		{
			Show(Entry->second, true);
		}
	}
	for (const terraport::FaceRange& Range : Change.baseBlocks)
	{
		const uint32 Index = Base.IsValid() && Base->BlockFaces > 0 ? Range.first / Base->BlockFaces : 0;
		if (Index >= Blocks.size() || !Blocks[Index].bHasBack)
		{
			continue;
		}
		FBlock& Block = Blocks[Index];
		Show(Block.Back, true);
		Discard(Block.Front);
		Block.Front = MoveTemp(Block.Back);
		Block.Back = FDrawable();
		Block.bHasBack = false;
		Block.bHasFront = true;
	}
}

bool FTerraportRenderer::Make(FDrawable& Drawable, FTerraportPreparedMesh& Prepared, UMaterialInterface* Material)
{
	Drawable.Piece = Backend->Create(Owner, Prepared, Material, Settings);
	Drawable.CreatedInFrame = GFrameCounter;
	if (Drawable.Piece.Component == nullptr)
	{
		return false;
	}
	if (++PieceCounts[Drawable.Piece.Component] == 1)
	{
		Keeper.Keep(Drawable.Piece.Component);
	}
	return true;
}

void FTerraportRenderer::Show(FDrawable& Drawable, bool bShown)
{
	// A block of the base whose faces are all hidden has no component, but counts as shown.
	Drawable.bShown = bShown;
	if (Drawable.Piece.Component != nullptr && IsValid(Drawable.Piece.Component))
	{
		Backend->SetShown(Drawable.Piece, bShown);
	}
}

void FTerraportRenderer::Discard(FDrawable& Drawable)
{
	if (Drawable.bShown)
	{
		Show(Drawable, false);
	}
	if (Drawable.Piece.Component != nullptr || Drawable.Texture != nullptr)
	{
		ToDestroy.push_back(MoveTemp(Drawable));
	}
	Drawable = FDrawable();
}

void FTerraportRenderer::Leave(FDrawable& Drawable)
{
	if (Drawable.bShown)
	{
		Leaving.push_back(MoveTemp(Drawable));
		Drawable = FDrawable();
	}
	else
	{
		Discard(Drawable);
	}
}

void FTerraportRenderer::Destroy(FDrawable& Drawable)
{
	UPrimitiveComponent* const Component = Drawable.Piece.Component;
	if (Component != nullptr)
	{
		Backend->Remove(Drawable.Piece);
		if (--PieceCounts[Component] == 0)
		{
			PieceCounts.erase(Component);
			// The level may have gone first, components and all; or the collector has found them together with the actor.
			if (IsValid(Component) && !Component->IsUnreachable())
			{
				Component->DestroyComponent();
			}
			Keeper.Release(Component);
		}
	}
	if (Drawable.Texture != nullptr)
	{
		ReleaseTexture(Drawable.Texture);
	}
	Drawable = FDrawable();
}

void FTerraportRenderer::ReleaseTexture(UTexture2D* Texture)
{
	// Its memory on the GPU now, not when the collector comes by, which may be a minute and some landings later.
	Texture->ReleaseResource();
	Keeper.Release(Texture);
}

UMaterialInterface* FTerraportRenderer::Textured(UMaterialInterface* Material, UTexture2D* Texture)
{
	UMaterialInstanceDynamic* Instance = Material != nullptr ? UMaterialInstanceDynamic::Create(Material, &Owner) : nullptr;
	if (Instance != nullptr)
	{
		Instance->SetTextureParameterValue(Materials.TextureParameter, Texture);
	}
	return Instance;
}
