#include "TerraportFeet.h"

#include "GameFramework/Actor.h"
#include "ProceduralMeshComponent.h"
#include "TerraportAxes.h"

#include <algorithm>
#include <cmath>

FTerraportFeet::FTerraportFeet(AActor& InOwner, ITerraportKeeper& InKeeper) : Owner(InOwner), Keeper(InKeeper) {}

FTerraportFeet::~FTerraportFeet()
{
	if (Component != nullptr)
	{
		// The level may have gone first, components and all.
		if (IsValid(Component) && !Component->IsUnreachable())
		{
			Component->DestroyComponent();
		}
		Keeper.Release(Component);
	}
}

void FTerraportFeet::Step(const terraport::ShownGround& Ground, const terraport::Vec3& Feet, double HalfM, int32 MaxFaces)
{
	if (Changes == Ground.changes() && !HasMovedOn(Feet))
	{
		return;
	}
	Changes = Ground.changes();
	Centre = Feet;
	ReachM = Ground.gather(Feet, HalfM, std::size_t(std::max(MaxFaces, 1)), Corners);
	if (Component == nullptr)
	{
		Component = NewObject<UProceduralMeshComponent>(&Owner, NAME_None, RF_Transient | RF_DuplicateTransient);
		// Off the game thread; the body before stays until the new one is cooked.
		Component->bUseAsyncCooking = true;
		Component->SetCastShadow(false);
		Component->SetupAttachment(Owner.GetRootComponent());
		Component->RegisterComponent();
		Keeper.Keep(Component);
	}
	Fill();
}

bool FTerraportFeet::HasMovedOn(const terraport::Vec3& Feet) const
{
	const double Away = std::max(std::abs(Feet.x - Centre.x), std::abs(Feet.z - Centre.z));
	return std::max(Away, std::abs(Feet.y - Centre.y)) > ReachM / 2.0;
}

void FTerraportFeet::Fill()
{
	FProcMeshSection Section;
	Section.bEnableCollision = true;
	// Solid, and not drawn: what is drawn there is the renderer's.
	Section.bSectionVisible = false;
	const int32 Count = int32(Corners.size() / 3);
	Section.ProcVertexBuffer.Reserve(Count);
	Section.ProcIndexBuffer.Reserve(Count);
	Section.SectionLocalBox = FBox(ForceInit);
	for (int32 Corner = 0; Corner < Count; ++Corner)
	{
		float Unreal[3];
		TerraportAxes::PointToUnreal(&Corners[std::size_t(3) * std::size_t(Corner)], Unreal);
		FProcMeshVertex Vertex;
		Vertex.Position = FVector(Unreal[0], Unreal[1], Unreal[2]);
		Section.SectionLocalBox += Vertex.Position;
		Section.ProcVertexBuffer.Add(Vertex);
		Section.ProcIndexBuffer.Add(uint32(Corner));
	}
	Component->SetProcMeshSection(0, Section);
	Component->SetMeshSectionVisible(0, false);
}
