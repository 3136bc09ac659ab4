#pragma once

#include "CoreMinimal.h"

#include "Core/Stage.h"
#include "TerraportKeeper.h"
#include "TerraportMeshPart.h"

#include <unordered_map>
#include <vector>

class AActor;
class UMaterialInstanceDynamic;
class UMaterialInterface;
class UTerraportGroundComponent;
class UTexture2D;

/** What the ground is drawn with. */
struct FTerraportMaterials
{
	UMaterialInterface* Colour = nullptr;
	UMaterialInterface* Texture = nullptr;
	UMaterialInterface* BaseColour = nullptr;
	UMaterialInterface* BaseTexture = nullptr;
	/** Texture parameter of `Texture` and `BaseTexture`. */
	FName TextureParameter;
	/** Scalar parameter of both base materials: centimetres that the base is pushed back along the line of sight. */
	FName PushParameter;
	/** As vertex colours of these materials are coded. */
	ETerraportVertexColours Coding = ETerraportVertexColours::Srgb;

	/**
	 * Those that are chosen; else those that terraport_materials.py made in this project; else the textured as the plain ones,
	 * the base's as the detail's, and for the detail the engine's debug material.
	 */
	static FTerraportMaterials Find(const FTerraportMaterials& Chosen, bool bLit, const FString& SceneName);
};

/**
 * Draws by components of one actor, each with up to 16 pieces of ground that lie together. Game thread.
 *
 * Every component stands at the actor's own transform: positions are in the vertices (TerraportAxes.h), so that neighbours meet
 * without cracks. The base is drawn in blocks; a block whose hidden faces change gets a second mesh, made and hidden before the
 * swap, which shows the one and hides the other.
 */
class FTerraportRenderer final : public terraport::Renderer
{
public:
	FTerraportRenderer(AActor& Owner, ITerraportKeeper& Keeper, const FTerraportMaterials& Materials, bool bCastShadow);
	/** Destroys every component. */
	virtual ~FTerraportRenderer() override;
	FTerraportRenderer(const FTerraportRenderer&) = delete;
	FTerraportRenderer& operator=(const FTerraportRenderer&) = delete;

	/** The base that `stepNewBase` makes from now on. */
	void BeginBase(TSharedRef<FTerraportBase, ESPMode::ThreadSafe> Base);

	/** Whether an image was not read since the last call; its ground is drawn in one colour. */
	bool TakeUnread();

	/** Destroy a slice of what is not drawn any more, until `EndS`. */
	void FreeSome(double EndS);

	virtual UploadState upload(terraport::Key Key, terraport::PreparedSegment& Prepared) override;
	virtual bool isDrawable(terraport::Key Key) override;
	virtual void free(terraport::Key Key) override;
	virtual bool stepNewBase() override;
	virtual void showBase() override;
	virtual bool stepBase(const terraport::FaceBits& HiddenFaces) override;
	virtual void swap(const terraport::Swap& Change) override;

private:
	struct FDrawable
	{
		UTerraportGroundComponent* Component = nullptr;
		/** Which of the component's pieces it is. */
		int32 Piece = 0;
		UTexture2D* Texture = nullptr;
		/** Frame in which it was made: its buffers reach the render thread before the next one is drawn. */
		uint64 CreatedInFrame = 0;
		bool bShown = false;
	};

	/** A block of the base, drawn without its hidden faces. */
	struct FBlock
	{
		FDrawable Front;
		std::vector<bool> FrontHidden;
		/** For the coming swap. */
		FDrawable Back;
		std::vector<bool> BackHidden;
		bool bHasBack = false;
	};

	struct FBaseDrawn
	{
		TSharedPtr<FTerraportBase, ESPMode::ThreadSafe> Base;
		std::vector<FBlock> Blocks;
		UTexture2D* Texture = nullptr;
		UMaterialInterface* Material = nullptr;
	};

	void Make(FDrawable& Drawable, TSharedRef<FTerraportGroundPiece, ESPMode::ThreadSafe> Piece, UMaterialInterface* Material);
	UTerraportGroundComponent* FindRoom(const FBox& Bounds) const;
	void Show(FDrawable& Drawable, bool bShown);
	/** Hidden at once, destroyed by and by. */
	void Discard(FDrawable& Drawable);
	void Destroy(FDrawable& Drawable);
	void ReleaseTexture(UTexture2D*& Texture);
	void MakeBlock(const FBaseDrawn& Of, std::size_t Block, const std::vector<bool>& Hidden, FDrawable& Drawable);
	void MakeBaseMaterial(FBaseDrawn& Of);
	void Discard(FBaseDrawn& Of);
	UMaterialInstanceDynamic* Instance(UMaterialInterface* Parent, UTexture2D* Texture);

	AActor& Owner;
	ITerraportKeeper& Keeper;
	const FTerraportMaterials Materials;
	const bool bCastShadow;
	std::unordered_map<terraport::Key, FDrawable> Segments;
	/** Those with pieces; each is kept from its first piece to its last. */
	std::vector<UTerraportGroundComponent*> Components;
	std::vector<FDrawable> ToDestroy;
	FBaseDrawn Drawn, Next;
	bool bUnread = false;
};
