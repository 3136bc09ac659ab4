#include "TerraportProceduralBackend.h"

#include "GameFramework/Actor.h"
#include "Materials/MaterialInterface.h"
#include "ProceduralMeshComponent.h"

namespace
{
class FTerraportProceduralMesh final : public FTerraportPreparedMesh
{
public:
	FProcMeshSection Section;
};

/** Position, normal and tangent, four pairs of texture coordinates of 16 bits, colour: what the engine's vertex factory takes.
 */
constexpr SIZE_T GpuVertexBytes = 12 + 8 + 16 + 4;
} // namespace

TUniquePtr<FTerraportPreparedMesh> FTerraportProceduralBackend::Prepare(const FTerraportMeshPart& Part) const
{
	TUniquePtr<FTerraportProceduralMesh> Mesh = MakeUnique<FTerraportProceduralMesh>();
	const int32 Count = Part.Positions.Num();
	Mesh->Section.ProcVertexBuffer.Reserve(Count);
	for (int32 Index = 0; Index < Count; ++Index)
	{
		FProcMeshVertex Vertex;
		Vertex.Position = FVector(Part.Positions[Index]);
		Vertex.Normal = FVector(Part.Normals[Index]);
		// Nothing has a normal map: any tangent that is not parallel to the normal will do.
		Vertex.Tangent = FProcMeshTangent(1.0f, 0.0f, 0.0f);
		Vertex.Color = Part.Colours.Num() > 0 ? Part.Colours[Index] : FColor(200, 200, 200, 255);
		if (Part.Uvs.Num() > 0)
		{
			Vertex.UV0 = FVector2D(Part.Uvs[Index]);
		}
		Mesh->Section.ProcVertexBuffer.Add(Vertex);
	}
	Mesh->Section.ProcIndexBuffer = Part.Indices;
	Mesh->Section.SectionLocalBox = FBox(FVector(Part.Bounds.Min), FVector(Part.Bounds.Max));
	Mesh->Section.bSectionVisible = false;
	return Mesh;
}

UPrimitiveComponent* FTerraportProceduralBackend::Create(
	AActor& Owner, FTerraportPreparedMesh& Prepared, UMaterialInterface* Material, const FTerraportMeshSettings& Settings)
{
	FTerraportProceduralMesh& Mesh = static_cast<FTerraportProceduralMesh&>(Prepared);
	UProceduralMeshComponent* Component = NewObject<UProceduralMeshComponent>(&Owner, NAME_None, RF_Transient);
	Component->bUseAsyncCooking = true;
	Component->SetCastShadow(Settings.bCastShadow);
	Component->SetCollisionEnabled(ECollisionEnabled::NoCollision);
	Component->SetupAttachment(Owner.GetRootComponent());
	Mesh.Section.bEnableCollision = Settings.bCollision;
	Component->SetProcMeshSection(0, Mesh.Section);
	Component->SetMeshSectionVisible(0, false);
	Component->SetMaterial(0, Material);
	// Filled first, registered last: the scene proxy, which copies the vertices, is then made within this call and not at the
	// end of the frame, where no budget sees it.
	Component->RegisterComponent();
	return Component;
}

void FTerraportProceduralBackend::SetShown(UPrimitiveComponent& Component, bool bShown)
{
	UProceduralMeshComponent& Mesh = static_cast<UProceduralMeshComponent&>(Component);
	Mesh.SetMeshSectionVisible(0, bShown);
	const FProcMeshSection* Section = Mesh.GetProcMeshSection(0);
	if (Section != nullptr && Section->bEnableCollision)
	{
		Mesh.SetCollisionEnabled(bShown ? ECollisionEnabled::QueryAndPhysics : ECollisionEnabled::NoCollision);
	}
}

SIZE_T FTerraportProceduralBackend::BytesOf(int32 Vertices, int32 Indices) const
{
	// The component keeps its own copy in main memory, which on a headset is the same memory.
	return SIZE_T(Vertices) * (GpuVertexBytes + sizeof(FProcMeshVertex)) + SIZE_T(Indices) * 2 * sizeof(uint32);
}
