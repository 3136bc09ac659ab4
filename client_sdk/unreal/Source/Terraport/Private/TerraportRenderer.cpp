#include "TerraportRenderer.h"

#include "Engine/Texture2D.h"
#include "GameFramework/Actor.h"
#include "HAL/PlatformTime.h"
#include "Materials/MaterialInstanceDynamic.h"
#include "Materials/MaterialInterface.h"
#include "TerraportAxes.h"
#include "TerraportGroundComponent.h"

#include <algorithm>
#include <utility>

namespace
{
/** Longest side of what one component draws, beyond which the engine's own culling of it (by occlusion, by the boxes of lights)
 * would find it everywhere: a landing of 60 m is two of them across. A larger piece has a component of its own. */
constexpr double MaxSideCm = 6400.0;

double LongestSide(const FBox& Box)
{
	const FVector Side = Box.Max - Box.Min;
	return std::max(Side.X, std::max(Side.Y, Side.Z));
}

std::vector<bool> HiddenOf(const FTerraportBase::FBlock& Block, const terraport::FaceBits& Faces)
{
	std::vector<bool> Hidden(Block.Faces.size());
	for (std::size_t At = 0; At < Hidden.size(); ++At)
	{
		const uint32 Face = Block.Faces[At];
		Hidden[At] = Face / 8 < Faces.size() && ((Faces[Face / 8] >> (Face % 8)) & 1) != 0;
	}
	return Hidden;
}
} // namespace

FTerraportRenderer::FTerraportRenderer(
	AActor& InOwner, ITerraportKeeper& InKeeper, const FTerraportMaterials& InMaterials, bool bInCastShadow)
	: Owner(InOwner), Keeper(InKeeper), Materials(InMaterials), bCastShadow(bInCastShadow)
{
	// The actor's properties may name others while this draws with these.
	for (UMaterialInterface* Material : {Materials.Colour, Materials.Texture, Materials.BaseColour, Materials.BaseTexture})
	{
		Keeper.Keep(Material);
	}
}

FTerraportRenderer::~FTerraportRenderer()
{
	for (auto& Entry : Segments)
	{
		Discard(Entry.second);
	}
	Discard(Drawn);
	Discard(Next);
	for (FDrawable& Drawable : ToDestroy)
	{
		Destroy(Drawable);
	}
	for (UMaterialInterface* Material : {Materials.Colour, Materials.Texture, Materials.BaseColour, Materials.BaseTexture})
	{
		Keeper.Release(Material);
	}
}

bool FTerraportRenderer::TakeUnread()
{
	return std::exchange(bUnread, false);
}

void FTerraportRenderer::FreeSome(double EndS)
{
	while (!ToDestroy.empty())
	{
		Destroy(ToDestroy.back());
		ToDestroy.pop_back();
		if (FPlatformTime::Seconds() >= EndS)
		{
			return;
		}
	}
}

// ---- segments

terraport::Renderer::UploadState FTerraportRenderer::upload(terraport::Key Key, terraport::PreparedSegment& Prepared)
{
	FTerraportPreparedSegment& Segment = static_cast<FTerraportPreparedSegment&>(Prepared);
	bUnread = bUnread || Segment.bUnread;
	FDrawable& Drawable = Segments[Key];
	if (!Segment.Pixels.IsEmpty())
	{
		// A step of its own: copying a megapixel with its mips takes about as long as a mesh.
		Drawable.Texture = TerraportTexture::MakeTexture(Segment.Pixels);
		Segment.Pixels = FTerraportPixels();
		if (Drawable.Texture != nullptr)
		{
			Keeper.Keep(Drawable.Texture);
			return UploadState::More;
		}
	}
	UMaterialInterface* Material = Materials.Colour;
	if (Drawable.Texture != nullptr)
	{
		Material = Instance(Materials.Texture, Drawable.Texture);
	}
	Make(Drawable, Segment.Piece.ToSharedRef(), Material);
	return UploadState::Done;
}

bool FTerraportRenderer::isDrawable(terraport::Key Key)
{
	const auto Entry = Segments.find(Key);
	return Entry != Segments.end() && Entry->second.CreatedInFrame < GFrameCounter;
}

void FTerraportRenderer::free(terraport::Key Key)
{
	const auto Entry = Segments.find(Key);
	if (Entry != Segments.end())
	{
		Discard(Entry->second);
		Segments.erase(Entry);
	}
}

void FTerraportRenderer::swap(const terraport::Swap& Change)
{
	const auto ShowAll = [this](const std::vector<terraport::Key>& Keys, bool bShown) {
		for (const terraport::Key Key : Keys)
		{
			const auto Entry = Segments.find(Key);
			if (Entry != Segments.end())
			{
				Show(Entry->second, bShown);
			}
		}
	};
	ShowAll(Change.hidden, false);
	ShowAll(Change.shown, true);
	for (FBlock& Block : Drawn.Blocks)
	{
		if (Block.bHasBack)
		{
			Show(Block.Back, true);
			Discard(Block.Front);
			Block.Front = std::exchange(Block.Back, FDrawable());
			Block.FrontHidden = std::move(Block.BackHidden);
			Block.bHasBack = false;
		}
	}
}

// ---- base

void FTerraportRenderer::BeginBase(TSharedRef<FTerraportBase, ESPMode::ThreadSafe> Base)
{
	Discard(Next);
	Next.Base = Base;
	bUnread = bUnread || Base->bUnread;
	MakeBaseMaterial(Next);
}

bool FTerraportRenderer::stepNewBase()
{
	if (!Next.Base.IsValid() || Next.Blocks.size() == Next.Base->Blocks.size())
	{
		return false;
	}
	const std::size_t At = Next.Blocks.size();
	Next.Blocks.emplace_back();
	FBlock& Block = Next.Blocks.back();
	Block.FrontHidden.resize(Next.Base->Blocks[At].Faces.size());
	MakeBlock(Next, At, Block.FrontHidden, Block.Front);
	return true;
}

void FTerraportRenderer::showBase()
{
	for (FBlock& Block : Next.Blocks)
	{
		Show(Block.Front, true);
	}
	Discard(Drawn);
	Drawn = std::exchange(Next, FBaseDrawn());
}

bool FTerraportRenderer::stepBase(const terraport::FaceBits& HiddenFaces)
{
	for (std::size_t At = 0; At < Drawn.Blocks.size(); ++At)
	{
		FBlock& Block = Drawn.Blocks[At];
		std::vector<bool> Hidden = HiddenOf(Drawn.Base->Blocks[At], HiddenFaces);
		if (Hidden == (Block.bHasBack ? Block.BackHidden : Block.FrontHidden))
		{
			continue;
		}
		Discard(Block.Back);
		Block.bHasBack = Hidden != Block.FrontHidden;
		if (Block.bHasBack)
		{
			MakeBlock(Drawn, At, Hidden, Block.Back);
		}
		Block.BackHidden = std::move(Hidden);
		return true;
	}
	return false;
}

void FTerraportRenderer::MakeBlock(
	const FBaseDrawn& Of, std::size_t Index, const std::vector<bool>& Hidden, FDrawable& Drawable)
{
	FTerraportMeshPart Part = Of.Base->Blocks[Index].Part;
	int32 Count = 0;
	for (std::size_t Face = 0; Face < Hidden.size(); ++Face)
	{
		for (int32 Corner = 0; !Hidden[Face] && Corner < 3; ++Corner)
		{
			Part.Indices[Count++] = Part.Indices[int32(3 * Face) + Corner];
		}
	}
	Part.Indices.SetNum(Count);
	if (Count > 0)
	{
		Make(Drawable, MakeShared<FTerraportGroundPiece, ESPMode::ThreadSafe>(Part), Of.Material);
	}
}

void FTerraportRenderer::MakeBaseMaterial(FBaseDrawn& Of)
{
	Of.Texture = TerraportTexture::MakeTexture(Of.Base->Pixels);
	if (Of.Texture != nullptr)
	{
		Keeper.Keep(Of.Texture);
	}
	UMaterialInstanceDynamic* Made = Instance(Of.Texture != nullptr ? Materials.BaseTexture : Materials.BaseColour, Of.Texture);
	if (Made != nullptr)
	{
		Keeper.Keep(Made);
		Made->SetScalarParameterValue(Materials.PushParameter, float(Of.Base->PushBackM) * TerraportAxes::CentimetresPerMetre);
	}
	Of.Material = Made;
}

void FTerraportRenderer::Discard(FBaseDrawn& Of)
{
	for (FBlock& Block : Of.Blocks)
	{
		Discard(Block.Front);
		Discard(Block.Back);
	}
	if (Of.Texture != nullptr)
	{
		ReleaseTexture(Of.Texture);
	}
	if (Of.Material != nullptr)
	{
		Keeper.Release(Of.Material);
	}
	Of = FBaseDrawn();
}

// ---- meshes

void FTerraportRenderer::Make(
	FDrawable& Drawable, TSharedRef<FTerraportGroundPiece, ESPMode::ThreadSafe> Piece, UMaterialInterface* Material)
{
	UTerraportGroundComponent* Component = FindRoom(Piece->Bounds);
	const bool bNew = Component == nullptr;
	if (bNew)
	{
		Component = NewObject<UTerraportGroundComponent>(&Owner, NAME_None, RF_Transient | RF_DuplicateTransient);
		Component->SetCastShadow(bCastShadow);
		Component->SetCollisionEnabled(ECollisionEnabled::NoCollision);
		Component->SetupAttachment(Owner.GetRootComponent());
		Components.push_back(Component);
		Keeper.Keep(Component);
	}
	Drawable.Component = Component;
	Drawable.Piece = Component->AddPiece(Piece, Material);
	Drawable.CreatedInFrame = GFrameCounter;
	if (bNew)
	{
		Component->RegisterComponent();
	}
}

/** The component that grows least by it, of those that have room and stay small; null where there is none. */
UTerraportGroundComponent* FTerraportRenderer::FindRoom(const FBox& Bounds) const
{
	UTerraportGroundComponent* Best = nullptr;
	double BestSideCm = MaxSideCm;
	for (UTerraportGroundComponent* Component : Components)
	{
		if (!IsValid(Component) || Component->GetNumPieces() == UTerraportGroundComponent::MaxPieces)
		{
			continue;
		}
		FBox United = Component->GetPieceBounds();
		United += Bounds;
		const double SideCm = LongestSide(United);
		// Of equals the first, which is the fuller.
		if (SideCm < BestSideCm || (Best == nullptr && SideCm <= MaxSideCm))
		{
			Best = Component;
			BestSideCm = SideCm;
		}
	}
	return Best;
}

void FTerraportRenderer::Show(FDrawable& Drawable, bool bShown)
{
	// A block of the base whose faces are all hidden has no component, but counts as shown.
	Drawable.bShown = bShown;
	if (Drawable.Component != nullptr && IsValid(Drawable.Component))
	{
		Drawable.Component->ShowPiece(Drawable.Piece, bShown);
	}
}

void FTerraportRenderer::Discard(FDrawable& Drawable)
{
	if (Drawable.bShown)
	{
		Show(Drawable, false);
	}
	if (Drawable.Component != nullptr || Drawable.Texture != nullptr)
	{
		ToDestroy.push_back(Drawable);
	}
	Drawable = FDrawable();
}

void FTerraportRenderer::Destroy(FDrawable& Drawable)
{
	UTerraportGroundComponent* const Component = Drawable.Component;
	if (Component != nullptr)
	{
		Component->RemovePiece(Drawable.Piece);
		if (Component->GetNumPieces() == 0)
		{
			Components.erase(std::remove(Components.begin(), Components.end(), Component), Components.end());
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

void FTerraportRenderer::ReleaseTexture(UTexture2D*& Texture)
{
	// Its memory on the GPU now, not when the collector comes by, which may be a minute and some landings later.
	Texture->ReleaseResource();
	Keeper.Release(Texture);
	Texture = nullptr;
}

UMaterialInstanceDynamic* FTerraportRenderer::Instance(UMaterialInterface* Parent, UTexture2D* Texture)
{
	UMaterialInstanceDynamic* Made = Parent != nullptr ? UMaterialInstanceDynamic::Create(Parent, &Owner) : nullptr;
	if (Made != nullptr && Texture != nullptr)
	{
		Made->SetTextureParameterValue(Materials.TextureParameter, Texture);
	}
	return Made;
}
