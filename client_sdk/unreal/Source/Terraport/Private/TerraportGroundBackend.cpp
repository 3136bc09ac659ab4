#include "TerraportGroundBackend.h"

#include "GameFramework/Actor.h"
#include "Materials/MaterialInterface.h"
#include "TerraportGroundComponent.h"
#include "TerraportGroundPiece.h"

#include <algorithm>

namespace
{
/** Longest side of what one component draws, beyond which the engine's own culling of it (by occlusion, by the boxes of lights)
 * would find it everywhere: a landing of 60 m is two of them across. A larger piece has a component of its own. */
constexpr double MaxSideCm = 6400.0;

class FTerraportGroundMesh final : public FTerraportPreparedMesh
{
public:
	explicit FTerraportGroundMesh(const FTerraportMeshPart& Part)
		: Piece(MakeShared<FTerraportGroundPiece, ESPMode::ThreadSafe>(Part))
	{
	}
	TSharedRef<FTerraportGroundPiece, ESPMode::ThreadSafe> Piece;
};

double LongestSide(const FBox& Box)
{
	const FVector Side = Box.Max - Box.Min;
	return std::max(Side.X, std::max(Side.Y, Side.Z));
}
} // namespace

TUniquePtr<FTerraportPreparedMesh> FTerraportGroundBackend::Prepare(const FTerraportMeshPart& Part) const
{
	return MakeUnique<FTerraportGroundMesh>(Part);
}

FTerraportPiece FTerraportGroundBackend::Create(
	AActor& Owner, FTerraportPreparedMesh& Prepared, UMaterialInterface* Material, const FTerraportMeshSettings& Settings)
{
	const FTerraportGroundMesh& Mesh = static_cast<FTerraportGroundMesh&>(Prepared);
	UTerraportGroundComponent* Component = FindRoom(Mesh.Piece->Bounds);
	const bool bNew = Component == nullptr;
	if (bNew)
	{
		Component = NewObject<UTerraportGroundComponent>(&Owner, NAME_None, RF_Transient | RF_DuplicateTransient);
		Component->SetCastShadow(Settings.bCastShadow);
		Component->SetCollisionEnabled(ECollisionEnabled::NoCollision);
		Component->SetupAttachment(Owner.GetRootComponent());
		Components.push_back(Component);
	}
	const int32 Index = Component->AddPiece(Mesh.Piece, Material);
	if (bNew)
	{
		Component->RegisterComponent();
	}
	return FTerraportPiece{Component, Index};
}

/** The component that grows least by it, of those that have room and stay small; null where there is none. */
UTerraportGroundComponent* FTerraportGroundBackend::FindRoom(const FBox& Bounds) const
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

void FTerraportGroundBackend::SetShown(const FTerraportPiece& Piece, bool bShown)
{
	static_cast<UTerraportGroundComponent*>(Piece.Component)->ShowPiece(Piece.Index, bShown);
}

void FTerraportGroundBackend::Remove(const FTerraportPiece& Piece)
{
	UTerraportGroundComponent* Component = static_cast<UTerraportGroundComponent*>(Piece.Component);
	Component->RemovePiece(Piece.Index);
	if (Component->GetNumPieces() == 0)
	{
		Components.erase(std::remove(Components.begin(), Components.end(), Component), Components.end());
	}
}

SIZE_T FTerraportGroundBackend::BytesOf(int32 Vertices, int32 Indices) const
{
	const SIZE_T Corner =
		FTerraportGroundPiece::CornerBytes * SIZE_T(Vertices <= FTerraportGroundPiece::MaxShortVertices ? 1 : 2);
	return SIZE_T(Vertices) * FTerraportGroundPiece::VertexBytes + SIZE_T(Indices) * Corner;
}
