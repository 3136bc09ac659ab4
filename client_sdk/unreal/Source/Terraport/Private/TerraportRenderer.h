#pragma once

#include "CoreMinimal.h"

#include "Terraport/SceneRenderer.h"
#include "TerraportKeeper.h"
#include "TerraportMeshBackend.h"
#include "TerraportMeshBuilder.h"
#include "TerraportSettings.h"

#include <unordered_map>
#include <vector>

class AActor;
class UMaterialInstanceDynamic;
class UMaterialInterface;
class UPrimitiveComponent;
class UTexture2D;

/** What the ground is drawn with. Each may be null: then the fallback. */
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
};

/**
 * Draws what the stage orders, by components of one actor. Game thread.
 *
 * Every component stands at the actor's own transform: positions are in the vertices (TerraportAxes.h), so that neighbours meet
 * without cracks. The base is drawn in blocks of its own order; a block whose hidden faces change gets a second component, made
 * and hidden before the swap, and the swap shows the one and hides the other.
 */
class FTerraportRenderer final : public terraport::SceneRenderer
{
public:
	FTerraportRenderer(AActor& Owner, ITerraportKeeper& Keeper, TSharedRef<ITerraportMeshBackend, ESPMode::ThreadSafe> Backend,
		const FTerraportMaterials& Materials, const FTerraportMeshSettings& Settings);
	/** Destroys every component. */
	virtual ~FTerraportRenderer() override;
	FTerraportRenderer(const FTerraportRenderer&) = delete;
	FTerraportRenderer& operator=(const FTerraportRenderer&) = delete;

	/** The base that the next `beginBase` is of. */
	void SetBase(TSharedRef<FTerraportBase, ESPMode::ThreadSafe> Base);

	/** Kind of an image that was not read, since the last call; None otherwise. Its ground is drawn in one colour. */
	terraport::ImageType TakeUnread();

	/** Once a frame: a slice of what is not urgent (the first components of the base, components to be destroyed), until
	 * `EndS`, but one piece at least. */
	void Step(double EndS);

	virtual terraport::UploadState upload(
		std::uint32_t Segment, const terraport::SegmentMesh& Mesh, terraport::ByteSpan Payload) override;
	virtual bool isDrawable(std::uint32_t Segment) override;
	virtual void free(std::uint32_t Segment) override;
	virtual std::size_t gpuBytesOf(const terraport::SegmentMesh& Mesh) const override;
	virtual void beginBase(const terraport::SceneFiles& Files) override;
	virtual void prepareBase(const terraport::FaceRange& Block, const terraport::HiddenFaces& Next) override;
	virtual bool isBaseReady() override;
	virtual void swap(const terraport::SceneSwap& Change) override;

private:
	struct FDrawable
	{
		FTerraportPiece Piece;
		UTexture2D* Texture = nullptr;
		/** Frame in which it was made: its resources reach the render thread before the next one is drawn. */
		uint64 CreatedInFrame = 0;
		bool bShown = false;
	};

	struct FBlock
	{
		FDrawable Front;
		FDrawable Back;
		bool bHasFront = false;
		bool bHasBack = false;
	};

	bool Make(FDrawable& Drawable, FTerraportPreparedMesh& Prepared, UMaterialInterface* Material);
	void Show(FDrawable& Drawable, bool bShown);
	/** Hidden at once, destroyed by and by. */
	void Discard(FDrawable& Drawable);
	/** Of an earlier version: drawn until the new base is, if it is drawn; else discarded. */
	void Leave(FDrawable& Drawable);
	void Destroy(FDrawable& Drawable);
	void ReleaseTexture(UTexture2D* Texture);
	void MakeBlock(uint32 Block, const terraport::HiddenFaces* Hidden, FDrawable& Drawable);
	void MakeBaseMaterial(double PushBackM);
	void ShowBase();
	UMaterialInterface* Textured(UMaterialInterface* Material, UTexture2D* Texture);

	AActor& Owner;
	ITerraportKeeper& Keeper;
	const TSharedRef<ITerraportMeshBackend, ESPMode::ThreadSafe> Backend;
	const FTerraportMaterials Materials;
	const FTerraportMeshSettings Settings;
	std::unordered_map<uint32, FDrawable> Segments;
	/** Pieces of each component that draws any: it is kept from the first to the last. */
	std::unordered_map<UPrimitiveComponent*, int32> PieceCounts;
	/** Segments and base of an earlier version, drawn until the new base is. */
	std::vector<FDrawable> Leaving;
	std::vector<FDrawable> ToDestroy;
	TSharedPtr<FTerraportBase, ESPMode::ThreadSafe> Base;
	std::vector<FBlock> Blocks;
	terraport::ImageType Unread = terraport::ImageType::None;
	UMaterialInterface* BaseMaterial = nullptr;
	UTexture2D* BaseTexture = nullptr;
	/** The next block that has no component yet. */
	uint32 NextBlock = 0;
	bool bBaseShown = false;
};
