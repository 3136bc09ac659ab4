#pragma once

#include "Components/MeshComponent.h"
#include "CoreMinimal.h"

#include "TerraportGroundComponent.generated.h"

class FTerraportGroundPiece;
struct FTerraportGroundSlots;
class UMaterialInterface;

/**
 * Draws up to 16 pieces of ground, each with a material of its own. A piece comes, is shown, is hidden and goes without a new
 * render state: the scene proxy reads them where the render thread keeps them. Nothing of a piece stays in main memory.
 *
 * Made by the scene; not for levels.
 */
UCLASS(Transient, NotBlueprintable, ClassGroup = "Terraport", meta = (DisplayName = "Terraport Ground"))
class TERRAPORT_API UTerraportGroundComponent : public UMeshComponent
{
	GENERATED_BODY()

public:
	static constexpr int32 MaxPieces = 16;

	UTerraportGroundComponent();

	/** Add a piece, hidden; returns its number, -1 where there is no room. Its number is used again once it is removed. */
	int32 AddPiece(TSharedRef<FTerraportGroundPiece, ESPMode::ThreadSafe> Piece, UMaterialInterface* Material);
	void ShowPiece(int32 Index, bool bShown);
	void RemovePiece(int32 Index);
	int32 GetNumPieces() const;
	/** Box of all pieces, component space; empty without any. */
	FBox GetPieceBounds() const;
	/** Triangles of the pieces that are shown, and bytes of all pieces on the graphics. */
	int64 GetShownTriangles() const;
	int64 GetGpuBytes() const;

	virtual FPrimitiveSceneProxy* CreateSceneProxy() override;
	virtual FBoxSphereBounds CalcBounds(const FTransform& LocalToWorld) const override;
	virtual int32 GetNumMaterials() const override;
	virtual UMaterialInterface* GetMaterial(int32 Index) const override;
	virtual void OnComponentDestroyed(bool bDestroyingHierarchy) override;
	virtual void BeginDestroy() override;

private:
	/** What the game thread has to know of a piece: the rest is the render thread's. */
	struct FFacts
	{
		FBox Bounds = FBox(ForceInit);
		int64 Triangles = 0;
		int64 GpuBytes = 0;
		bool bUsed = false;
		bool bShown = false;
	};

	void RemoveAll();
	/** After pieces have changed: the box by which the engine culls, and what passes the materials take part in. */
	void UpdateProxy(bool bNewMaterial);

	UPROPERTY(Transient)
	TArray<TObjectPtr<UMaterialInterface>> PieceMaterials;

	FFacts Facts[MaxPieces];
	TSharedPtr<FTerraportGroundSlots, ESPMode::ThreadSafe> Slots;
};
