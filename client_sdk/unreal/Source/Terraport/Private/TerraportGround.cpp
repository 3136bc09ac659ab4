#include "TerraportGround.h"

#include "TerraportAxes.h"

#include <algorithm>
#include <cmath>

namespace
{
constexpr int32 BoxFaces = 64;

/** Whether a ray enters a box at all before MaxAt: the slabs of its three axes (Kay and Kajiya, 1986). */
bool EntersBox(const FBox3f& Box, const float Origin[3], const float Direction[3], float MaxAt)
{
	const float Least[3] = {Box.Min.X, Box.Min.Y, Box.Min.Z};
	const float Most[3] = {Box.Max.X, Box.Max.Y, Box.Max.Z};
	float Enter = 0.0f, Leave = MaxAt;
	for (int Axis = 0; Axis < 3; ++Axis)
	{
		if (Direction[Axis] == 0.0f)
		{
			if (Origin[Axis] < Least[Axis] || Origin[Axis] > Most[Axis])
			{
				return false;
			}
			continue;
		}
		const float ToLeast = (Least[Axis] - Origin[Axis]) / Direction[Axis];
		const float ToMost = (Most[Axis] - Origin[Axis]) / Direction[Axis];
		Enter = std::max(Enter, std::min(ToLeast, ToMost));
		Leave = std::min(Leave, std::max(ToLeast, ToMost));
	}
	return Enter <= Leave;
}
} // namespace

FTerraportGroundMesh::FTerraportGroundMesh(const TArray<FVector3f>& InPositions, const TArray<uint32>& InIndices)
	: Positions(InPositions), Indices(InIndices)
{
	const int32 Faces = Indices.Num() / 3;
	Boxes.reserve(std::size_t((Faces + BoxFaces - 1) / BoxFaces));
	for (int32 First = 0; First < Faces; First += BoxFaces)
	{
		FBox3f Box(ForceInit);
		for (int32 Index = 3 * First; Index < 3 * std::min(First + BoxFaces, Faces); ++Index)
		{
			Box += Positions[int32(Indices[Index])];
		}
		Whole += Box.Min;
		Whole += Box.Max;
		Boxes.push_back(Box);
	}
}

template <typename Visit>
void FTerraportGroundMesh::VisitHits(const FVector3f& Origin, const FVector3f& Direction, float MaxAt, Visit&& Take) const
{
	const float From[3] = {Origin.X, Origin.Y, Origin.Z};
	const float Along[3] = {Direction.X, Direction.Y, Direction.Z};
	const int32 Faces = Indices.Num() / 3;
	// 1. The box around everything: most meshes of a scene end here.
	if (Faces == 0 || !EntersBox(Whole, From, Along, MaxAt))
	{
		return;
	}
	// 2. The boxes of BoxFaces consecutive faces each.
	for (std::size_t Box = 0; Box < Boxes.size(); ++Box)
	{
		if (!EntersBox(Boxes[Box], From, Along, MaxAt))
		{
			continue;
		}
		const int32 First = int32(Box) * BoxFaces;
		for (int32 Face = First; Face < std::min(First + BoxFaces, Faces); ++Face)
		{
			// 3. Moeller and Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection", 1997; both sides of the face count.
			const FVector3f& A = Positions[int32(Indices[3 * Face])];
			const FVector3f& B = Positions[int32(Indices[3 * Face + 1])];
			const FVector3f& C = Positions[int32(Indices[3 * Face + 2])];
			const FVector3f U = B - A, V = C - A;
			const FVector3f P = FVector3f::CrossProduct(Direction, V);
			const float Determinant = FVector3f::DotProduct(U, P);
			if (Determinant == 0.0f)
			{
				continue;
			}
			const FVector3f T = Origin - A;
			const float Beta = FVector3f::DotProduct(T, P) / Determinant;
			const FVector3f Q = FVector3f::CrossProduct(T, U);
			const float Gamma = FVector3f::DotProduct(Direction, Q) / Determinant;
			const float At = FVector3f::DotProduct(V, Q) / Determinant;
			if (Beta < 0.0f || Gamma < 0.0f || Beta + Gamma > 1.0f || !(At > 0.0f && At <= MaxAt))
			{
				continue;
			}
			// 4. The normal of the drawn side, whichever side the ray came from.
			FTerraportGroundPoint Point;
			Point.At = At;
			const float CornerA[3] = {A.X, A.Y, A.Z}, CornerB[3] = {B.X, B.Y, B.Z}, CornerC[3] = {C.X, C.Y, C.Z};
			float Front[3];
			TerraportAxes::FrontOfFace(CornerA, CornerB, CornerC, Front);
			const float Length = std::sqrt(Front[0] * Front[0] + Front[1] * Front[1] + Front[2] * Front[2]);
			Point.Normal = Length > 0.0f ? FVector3f(Front[0] / Length, Front[1] / Length, Front[2] / Length)
										 : FVector3f(0.0f, 0.0f, 1.0f);
			Take(Point);
		}
	}
}

bool FTerraportGroundMesh::Cast(
	const FVector3f& Origin, const FVector3f& Direction, float MaxAt, FTerraportGroundPoint& Point) const
{
	bool bHit = false;
	VisitHits(Origin, Direction, MaxAt, [&bHit, &Point](const FTerraportGroundPoint& Hit) {
		if (!bHit || Hit.At < Point.At)
		{
			Point = Hit;
			bHit = true;
		}
	});
	return bHit;
}

void FTerraportGroundMesh::CastAll(
	const FVector3f& Origin, const FVector3f& Direction, float MaxAt, std::vector<FTerraportGroundPoint>& Points) const
{
	VisitHits(Origin, Direction, MaxAt, [&Points](const FTerraportGroundPoint& Hit) { Points.push_back(Hit); });
}
