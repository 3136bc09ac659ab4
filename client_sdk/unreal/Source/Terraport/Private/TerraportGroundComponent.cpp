#include "TerraportGroundComponent.h"

#include "Engine/World.h"
#include "MaterialDomain.h"
#include "Materials/Material.h"
#include "Materials/MaterialRenderProxy.h"
#include "Misc/EngineVersionComparison.h"
#include "PrimitiveSceneProxy.h"
#include "PrimitiveViewRelevance.h"
#include "RenderingThread.h"
#include "SceneInterface.h"
#include "SceneManagement.h"
#include "TerraportGroundPiece.h"

#include <utility>

/** The pieces of a component, for the render thread alone. Outlives a proxy that is made anew, and the component. */
struct FTerraportGroundSlots
{
	TSharedPtr<FTerraportGroundPiece, ESPMode::ThreadSafe> Pieces[UTerraportGroundComponent::MaxPieces];
	FMaterialRelevance Relevance;
};

namespace
{
using FSlots = TSharedPtr<FTerraportGroundSlots, ESPMode::ThreadSafe>;

class FTerraportGroundProxy final : public FPrimitiveSceneProxy
{
public:
	FTerraportGroundProxy(const UTerraportGroundComponent& Component, const FSlots& InSlots)
		: FPrimitiveSceneProxy(&Component), Slots(InSlots)
	{
		// Pieces come with materials that the component did not have when this was made.
		bVerifyUsedMaterials = false;
	}

	virtual SIZE_T GetTypeHash() const override
	{
		static SIZE_T UniquePointer;
		return reinterpret_cast<SIZE_T>(&UniquePointer);
	}

	virtual uint32 GetMemoryFootprint() const override { return uint32(sizeof(*this) + GetAllocatedSize()); }

	virtual FPrimitiveViewRelevance GetViewRelevance(const FSceneView* View) const override
	{
		FPrimitiveViewRelevance Result;
		Result.bDrawRelevance = IsShown(View);
		Result.bShadowRelevance = IsShadowCast(View);
		Result.bDynamicRelevance = true;
		Result.bRenderInMainPass = ShouldRenderInMainPass();
		Result.bUsesLightingChannels = GetLightingChannelMask() != GetDefaultLightingChannelMask();
		Result.bRenderCustomDepth = ShouldRenderCustomDepth();
		Slots->Relevance.SetPrimitiveViewRelevance(Result);
		return Result;
	}

	virtual bool CanBeOccluded() const override { return !Slots->Relevance.bDisableDepthTest; }

	virtual void GetDynamicMeshElements(const TArray<const FSceneView*>& Views, const FSceneViewFamily&, uint32 VisibilityMap,
		FMeshElementCollector& Collector) const override
	{
		FDynamicPrimitiveUniformBuffer* Uniforms = nullptr;
		for (int32 ViewIndex = 0; ViewIndex < Views.Num(); ++ViewIndex)
		{
			if ((VisibilityMap & (1u << ViewIndex)) == 0)
			{
				continue;
			}
			for (const TSharedPtr<FTerraportGroundPiece, ESPMode::ThreadSafe>& Piece : Slots->Pieces)
			{
				if (!Piece.IsValid() || !Piece->bShown || !IsInView(*Piece, *Views[ViewIndex]))
				{
					continue;
				}
				if (Uniforms == nullptr)
				{
					Uniforms = &MakeUniforms(Collector);
				}
				Collector.AddMesh(ViewIndex, BatchOf(*Piece, *Uniforms, Collector));
			}
		}
	}

private:
	/** Whether a piece may be seen: the engine has looked at the component's box, which is that of up to 16. */
	bool IsInView(const FTerraportGroundPiece& Piece, const FSceneView& View) const
	{
		// A shadow's view has the frustum of the camera: what casts into it may lie outside.
		if (View.GetDynamicMeshElementsShadowCullFrustum() != nullptr)
		{
			return true;
		}
		const FBox World = Piece.Bounds.TransformBy(GetLocalToWorld());
		return View.ViewFrustum.IntersectBox(World.GetCenter(), World.GetExtent());
	}

	FDynamicPrimitiveUniformBuffer& MakeUniforms(FMeshElementCollector& Collector) const
	{
		bool bHasPrecomputedVolumetricLightmap;
		FMatrix PreviousLocalToWorld;
		int32 SingleCaptureIndex;
		bool bOutputVelocity;
		GetScene().GetPrimitiveUniformShaderParameters_RenderThread(GetPrimitiveSceneInfo(), bHasPrecomputedVolumetricLightmap,
			PreviousLocalToWorld, SingleCaptureIndex, bOutputVelocity);
		FDynamicPrimitiveUniformBuffer& Uniforms = Collector.AllocateOneFrameResource<FDynamicPrimitiveUniformBuffer>();
		Uniforms.Set(Collector.GetRHICommandList(), GetLocalToWorld(), PreviousLocalToWorld, GetBounds(), GetLocalBounds(),
			ReceivesDecals(), bHasPrecomputedVolumetricLightmap, bOutputVelocity);
		return Uniforms;
	}

	FMeshBatch& BatchOf(const FTerraportGroundPiece& Piece, const FDynamicPrimitiveUniformBuffer& Uniforms,
		FMeshElementCollector& Collector) const
	{
		FMeshBatch& Mesh = Collector.AllocateMesh();
		Mesh.VertexFactory = Piece.VertexFactory.Get();
		Mesh.MaterialRenderProxy = Piece.Material->GetRenderProxy();
		Mesh.ReverseCulling = IsLocalToWorldDeterminantNegative();
		Mesh.Type = PT_TriangleList;
		Mesh.DepthPriorityGroup = SDPG_World;
		// Wireframe and the other view modes of the editor are then the engine's business.
		Mesh.bCanApplyViewModeOverrides = true;
		FMeshBatchElement& Element = Mesh.Elements[0];
		Element.IndexBuffer = &Piece.Indices;
		Element.PrimitiveUniformBufferResource = &Uniforms.UniformBuffer;
		Element.FirstIndex = 0;
		Element.NumPrimitives = Piece.NumTriangles();
		Element.MinVertexIndex = 0;
		Element.MaxVertexIndex = uint32(Piece.NumVertices - 1);
		return Mesh;
	}

	const FSlots Slots;
};
} // namespace

UTerraportGroundComponent::UTerraportGroundComponent() : Slots(MakeShared<FTerraportGroundSlots, ESPMode::ThreadSafe>())
{
	PrimaryComponentTick.bCanEverTick = false;
}

int32 UTerraportGroundComponent::AddPiece(
	TSharedRef<FTerraportGroundPiece, ESPMode::ThreadSafe> Piece, UMaterialInterface* Material)
{
	int32 Index = 0;
	while (Index < MaxPieces && Facts[Index].bUsed)
	{
		++Index;
	}
	if (Index == MaxPieces)
	{
		return -1;
	}
	UMaterialInterface* const Drawn = Material != nullptr ? Material : UMaterial::GetDefaultMaterial(MD_Surface);
	while (PieceMaterials.Num() <= Index)
	{
		PieceMaterials.Add(nullptr);
	}
	PieceMaterials[Index] = Drawn;
	Piece->Material = Drawn;
	Facts[Index] = FFacts{Piece->Bounds, int64(Piece->NumTriangles()), int64(Piece->GpuBytes()), true, false};
	const UWorld* World = GetWorld();
	const ERHIFeatureLevel::Type Level = World != nullptr ? World->GetFeatureLevel() : GMaxRHIFeatureLevel;
	ENQUEUE_RENDER_COMMAND(TerraportAddPiece)
	([Kept = Slots, Index, Piece, Level](FRHICommandListImmediate& RHICmdList) {
		Piece->Init(RHICmdList, Level);
		Kept->Pieces[Index] = Piece;
	});
	UpdateProxy(true);
	return Index;
}

void UTerraportGroundComponent::ShowPiece(int32 Index, bool bShown)
{
	if (Index < 0 || Index >= MaxPieces || !Facts[Index].bUsed || Facts[Index].bShown == bShown)
	{
		return;
	}
	Facts[Index].bShown = bShown;
	ENQUEUE_RENDER_COMMAND(TerraportShowPiece)
	([Kept = Slots, Index, bShown](FRHICommandListImmediate&) {
		if (Kept->Pieces[Index].IsValid())
		{
			Kept->Pieces[Index]->bShown = bShown;
		}
	});
}

void UTerraportGroundComponent::RemovePiece(int32 Index)
{
	if (Index < 0 || Index >= MaxPieces || !Facts[Index].bUsed)
	{
		return;
	}
	Facts[Index] = FFacts();
	PieceMaterials[Index] = nullptr;
	ENQUEUE_RENDER_COMMAND(TerraportRemovePiece)
	([Kept = Slots, Index](FRHICommandListImmediate&) {
		if (Kept->Pieces[Index].IsValid())
		{
			Kept->Pieces[Index]->Release();
			Kept->Pieces[Index].Reset();
		}
	});
	UpdateProxy(false);
}

int32 UTerraportGroundComponent::GetNumPieces() const
{
	int32 Count = 0;
	for (const FFacts& Fact : Facts)
	{
		Count += Fact.bUsed ? 1 : 0;
	}
	return Count;
}

FBox UTerraportGroundComponent::GetPieceBounds() const
{
	FBox Box(ForceInit);
	for (const FFacts& Fact : Facts)
	{
		if (Fact.bUsed)
		{
			Box += Fact.Bounds;
		}
	}
	return Box;
}

int64 UTerraportGroundComponent::GetShownTriangles() const
{
	int64 Count = 0;
	for (const FFacts& Fact : Facts)
	{
		Count += Fact.bShown ? Fact.Triangles : 0;
	}
	return Count;
}

int64 UTerraportGroundComponent::GetGpuBytes() const
{
	int64 Bytes = 0;
	for (const FFacts& Fact : Facts)
	{
		Bytes += Fact.GpuBytes;
	}
	return Bytes;
}

FPrimitiveSceneProxy* UTerraportGroundComponent::CreateSceneProxy()
{
	return new FTerraportGroundProxy(*this, Slots);
}

FBoxSphereBounds UTerraportGroundComponent::CalcBounds(const FTransform& LocalToWorld) const
{
	const FBox Box = GetPieceBounds();
	return FBoxSphereBounds(Box.IsValid != 0 ? Box : FBox(FVector::ZeroVector, FVector::ZeroVector)).TransformBy(LocalToWorld);
}

int32 UTerraportGroundComponent::GetNumMaterials() const
{
	return PieceMaterials.Num();
}

UMaterialInterface* UTerraportGroundComponent::GetMaterial(int32 Index) const
{
	return Index >= 0 && Index < PieceMaterials.Num() ? PieceMaterials[Index].Get() : nullptr;
}

void UTerraportGroundComponent::OnComponentDestroyed(bool bDestroyingHierarchy)
{
	// The proxy goes with the registration; its own command comes before these.
	Super::OnComponentDestroyed(bDestroyingHierarchy);
	RemoveAll();
}

void UTerraportGroundComponent::BeginDestroy()
{
	RemoveAll();
	Super::BeginDestroy();
}

void UTerraportGroundComponent::RemoveAll()
{
	for (int32 Index = 0; Index < MaxPieces; ++Index)
	{
		RemovePiece(Index);
	}
}

void UTerraportGroundComponent::UpdateProxy(bool bNewMaterial)
{
	UpdateBounds();
	MarkRenderTransformDirty();
	const UWorld* World = GetWorld();
	if (!bNewMaterial || World == nullptr || World->Scene == nullptr)
	{
		return;
	}
#if UE_VERSION_OLDER_THAN(5, 7, 0)
	const FMaterialRelevance Relevance = GetMaterialRelevance(World->GetFeatureLevel());
#else
	const FMaterialRelevance Relevance = GetMaterialRelevance(World->Scene->GetShaderPlatform());
#endif
	ENQUEUE_RENDER_COMMAND(TerraportRelevance)
	([Kept = Slots, Relevance](FRHICommandListImmediate&) { Kept->Relevance = Relevance; });
}
