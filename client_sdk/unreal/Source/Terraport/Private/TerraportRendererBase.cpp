#include "TerraportRenderer.h"

#include "Engine/Texture2D.h"
#include "GameFramework/Actor.h"
#include "Materials/MaterialInstanceDynamic.h"
#include "Materials/MaterialInterface.h"
#include "TerraportAxes.h"

#include <utility>

// The base: blocks of its own order, each with a component that is drawn and perhaps one for the coming swap.

void FTerraportRenderer::beginBase(const terraport::SceneFiles& Files)
{
	for (auto& Entry : Segments)
	{
		Leave(Entry.second);
	}
	Segments.clear();
	for (FBlock& Block : Blocks)
	{
		Discard(Block.Back);
		Leave(Block.Front);
	}
	Blocks.clear();
	NextBlock = 0;
	bBaseShown = false;
	if (Base.IsValid())
	{
		Blocks.resize(Base->Blocks.size());
		MakeBaseMaterial(Files.manifest.deviationM);
	}
}

void FTerraportRenderer::prepareBase(const terraport::FaceRange& Range, const terraport::HiddenFaces& Next)
{
	if (!Base.IsValid() || Base->BlockFaces == 0)
	{
		return;
	}
	const uint32 Index = Range.first / Base->BlockFaces;
	if (Index >= Blocks.size())
	{
		return;
	}
	FBlock& Block = Blocks[Index];
	Discard(Block.Back);
	MakeBlock(Index, &Next, Block.Back);
	Block.bHasBack = true;
}

bool FTerraportRenderer::isBaseReady()
{
	return bBaseShown;
}

void FTerraportRenderer::MakeBlock(uint32 Index, const terraport::HiddenFaces* Hidden, FDrawable& Drawable)
{
	const FTerraportMeshPart& Whole = Base->Blocks[Index];
	FTerraportMeshPart Part = Whole;
	if (Hidden != nullptr)
	{
		const std::size_t First = std::size_t(Index) * Base->BlockFaces;
		Part.Indices.Reset();
		for (int32 Face = 0; Face < Whole.Indices.Num() / 3; ++Face)
		{
			const std::size_t At = First + std::size_t(Face);
			if (At < Hidden->faceCount && Hidden->faces[At] != 0)
			{
				continue;
			}
			for (int32 Corner = 0; Corner < 3; ++Corner)
			{
				Part.Indices.Add(Whole.Indices[3 * Face + Corner]);
			}
		}
	}
	if (Part.Indices.Num() == 0)
	{
		return; // Nothing of it is drawn.
	}
	const TUniquePtr<FTerraportPreparedMesh> Prepared = Backend->Prepare(Part);
	if (Prepared.IsValid())
	{
		(void)Make(Drawable, *Prepared, BaseMaterial);
	}
}

void FTerraportRenderer::MakeBaseMaterial(double PushBackM)
{
	if (BaseTexture != nullptr)
	{
		Keeper.Release(BaseTexture);
	}
	if (BaseMaterial != nullptr)
	{
		Keeper.Release(BaseMaterial);
	}
	BaseTexture = TerraportTexture::MakeTexture(Base->Pixels);
	if (BaseTexture != nullptr)
	{
		Keeper.Keep(BaseTexture);
	}
	UMaterialInterface* Parent = BaseTexture != nullptr ? Materials.BaseTexture : Materials.BaseColour;
	UMaterialInstanceDynamic* Instance = Parent != nullptr ? UMaterialInstanceDynamic::Create(Parent, &Owner) : nullptr;
	BaseMaterial = Instance;
	if (Instance != nullptr)
	{
		Keeper.Keep(Instance);
		Instance->SetScalarParameterValue(Materials.PushParameter, float(PushBackM) * TerraportAxes::CentimetresPerMetre);
		if (BaseTexture != nullptr)
		{
			Instance->SetTextureParameterValue(Materials.TextureParameter, BaseTexture);
		}
	}
}

void FTerraportRenderer::ShowBase()
{
	for (FBlock& Block : Blocks)
	{
		Show(Block.Front, true);
	}
	bBaseShown = true;
	for (FDrawable& Drawable : Leaving)
	{
		Discard(Drawable);
	}
	Leaving.clear();
}
