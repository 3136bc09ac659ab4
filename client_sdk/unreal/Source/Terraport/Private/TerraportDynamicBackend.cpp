#include "TerraportDynamicBackend.h"

#include "Components/DynamicMeshComponent.h"
#include "DynamicMesh/DynamicMesh3.h"
#include "DynamicMesh/DynamicMeshAttributeSet.h"
#include "GameFramework/Actor.h"
#include "Materials/MaterialInterface.h"

namespace
{
using UE::Geometry::FDynamicMesh3;
using UE::Geometry::FDynamicMeshAttributeSet;
using UE::Geometry::FIndex3i;

class FTerraportDynamicMesh final : public FTerraportPreparedMesh
{
public:
	FDynamicMesh3 Mesh;
};

/** Vertex and overlay elements stand in the same order, so one number means all of them. */
int AppendVertex(FDynamicMesh3& Mesh, const FTerraportMeshPart& Part, int32 Index)
{
	FDynamicMeshAttributeSet* Attributes = Mesh.Attributes();
	Attributes->PrimaryNormals()->AppendElement(Part.Normals[Index]);
	Attributes->PrimaryUV()->AppendElement(Part.Uvs.Num() > 0 ? Part.Uvs[Index] : FVector2f(0.0f, 0.0f));
	const FColor Colour = Part.Colours.Num() > 0 ? Part.Colours[Index] : FColor(200, 200, 200, 255);
	Attributes->PrimaryColors()->AppendElement(
		FVector4f(float(Colour.R) / 255.0f, float(Colour.G) / 255.0f, float(Colour.B) / 255.0f, 1.0f));
	return Mesh.AppendVertex(FVector3d(Part.Positions[Index]));
}
} // namespace

TUniquePtr<FTerraportPreparedMesh> FTerraportDynamicBackend::Prepare(const FTerraportMeshPart& Part) const
{
	TUniquePtr<FTerraportDynamicMesh> Prepared = MakeUnique<FTerraportDynamicMesh>();
	FDynamicMesh3& Mesh = Prepared->Mesh;
	Mesh.EnableAttributes();
	Mesh.Attributes()->EnablePrimaryColors();
	for (int32 Index = 0; Index < Part.Positions.Num(); ++Index)
	{
		AppendVertex(Mesh, Part, Index);
	}
	for (int32 First = 0; First + 2 < Part.Indices.Num(); First += 3)
	{
		FIndex3i Corners(int(Part.Indices[First]), int(Part.Indices[First + 1]), int(Part.Indices[First + 2]));
		if (Corners.A == Corners.B || Corners.B == Corners.C || Corners.C == Corners.A)
		{
			continue; // No area, and this kind of mesh does not take it.
		}
		int Triangle = Mesh.AppendTriangle(Corners);
		if (Triangle < 0)
		{
			// A third face at one edge, which a surveyed surface may have: it gets vertices of its own.
			Corners = FIndex3i(AppendVertex(Mesh, Part, int32(Part.Indices[First])),
				AppendVertex(Mesh, Part, int32(Part.Indices[First + 1])),
				AppendVertex(Mesh, Part, int32(Part.Indices[First + 2])));
			Triangle = Mesh.AppendTriangle(Corners);
		}
		if (Triangle >= 0)
		{
			Mesh.Attributes()->PrimaryNormals()->SetTriangle(Triangle, Corners);
			Mesh.Attributes()->PrimaryUV()->SetTriangle(Triangle, Corners);
			Mesh.Attributes()->PrimaryColors()->SetTriangle(Triangle, Corners);
		}
	}
	return Prepared;
}

FTerraportPiece FTerraportDynamicBackend::Create(
	AActor& Owner, FTerraportPreparedMesh& Prepared, UMaterialInterface* Material, const FTerraportMeshSettings& Settings)
{
	UDynamicMeshComponent* Component =
		NewObject<UDynamicMeshComponent>(&Owner, NAME_None, RF_Transient | RF_DuplicateTransient);
	Component->bUseAsyncCooking = true;
	Component->SetCastShadow(Settings.bCastShadow);
	Component->SetCollisionEnabled(ECollisionEnabled::NoCollision);
	Component->SetComplexAsSimpleCollisionEnabled(Settings.bCollision, false);
	Component->SetupAttachment(Owner.GetRootComponent());
	Component->SetMesh(MoveTemp(static_cast<FTerraportDynamicMesh&>(Prepared).Mesh));
	Component->SetMaterial(0, Material);
	Component->SetVisibility(false);
	Component->RegisterComponent();
	return FTerraportPiece{Component, 0};
}

void FTerraportDynamicBackend::SetShown(const FTerraportPiece& Piece, bool bShown)
{
	UDynamicMeshComponent& Mesh = static_cast<UDynamicMeshComponent&>(*Piece.Component);
	Mesh.SetVisibility(bShown);
	if (Mesh.bEnableComplexCollision)
	{
		Mesh.SetCollisionEnabled(bShown ? ECollisionEnabled::QueryAndPhysics : ECollisionEnabled::NoCollision);
	}
}

SIZE_T FTerraportDynamicBackend::BytesOf(int32 Vertices, int32 Indices) const
{
	// About what FDynamicMesh3 keeps of a vertex with three overlays, and of a corner with its edges, beside the GPU's copy.
	return SIZE_T(Vertices) * (32 + 120) + SIZE_T(Indices) * (4 + 28);
}
