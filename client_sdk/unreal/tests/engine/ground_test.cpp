#include "TerraportGround.h"

#include <doctest/doctest.h>

#include <cmath>
#include <random>

namespace
{
/// A hilly sheet of `Side` x `Side` squares of 100 cm, many boxes of faces.
FTerraportGroundMesh MakeHills(int32 Side, TArray<FVector3f>& Positions, TArray<uint32>& Indices)
{
	for (int32 Y = 0; Y <= Side; ++Y)
	{
		for (int32 X = 0; X <= Side; ++X)
		{
			Positions.Add(
				FVector3f(100.0f * float(X), 100.0f * float(Y), 80.0f * std::sin(0.7f * float(X)) * std::cos(0.4f * float(Y))));
		}
	}
	for (int32 Y = 0; Y < Side; ++Y)
	{
		for (int32 X = 0; X < Side; ++X)
		{
			const uint32 A = uint32(Y * (Side + 1) + X), B = A + 1, C = A + uint32(Side) + 1, D = C + 1;
			for (const uint32 Corner : {A, C, B, B, C, D})
			{
				Indices.Add(Corner);
			}
		}
	}
	return FTerraportGroundMesh(Positions, Indices);
}
} // namespace

TEST_CASE("a ray straight down meets the sheet at its height, from both sides")
{
	TArray<FVector3f> Positions;
	TArray<uint32> Indices;
	const FTerraportGroundMesh Ground = MakeHills(20, Positions, Indices);
	FTerraportGroundPoint Point;
	REQUIRE(Ground.Cast(FVector3f(700.0f, 900.0f, 5000.0f), FVector3f(0.0f, 0.0f, -1.0f), 1e6f, Point));
	CHECK(5000.0f - Point.At == doctest::Approx(80.0f * std::sin(4.9f) * std::cos(3.6f)));
	CHECK(Point.Normal.Z > 0.3f);
	REQUIRE(Ground.Cast(FVector3f(700.0f, 900.0f, -5000.0f), FVector3f(0.0f, 0.0f, 1.0f), 1e6f, Point));
	CHECK_FALSE(Ground.Cast(FVector3f(700.0f, 900.0f, 5000.0f), FVector3f(0.0f, 0.0f, -1.0f), 1000.0f, Point));
	CHECK_FALSE(Ground.Cast(FVector3f(-10.0f, 900.0f, 5000.0f), FVector3f(0.0f, 0.0f, -1.0f), 1e6f, Point));
}

TEST_CASE("boxes change nothing of what rays meet")
{
	TArray<FVector3f> Positions;
	TArray<uint32> Indices;
	const FTerraportGroundMesh Ground = MakeHills(24, Positions, Indices);
	// 1. The reference: each face alone, in a mesh of its own, with no box to be wrong about but its own.
	std::vector<FTerraportGroundMesh> Faces;
	for (int32 First = 0; First < Indices.Num(); First += 3)
	{
		TArray<FVector3f> Corners;
		TArray<uint32> Order;
		for (int32 Corner = 0; Corner < 3; ++Corner)
		{
			Corners.Add(Positions[int32(Indices[First + Corner])]);
			Order.Add(uint32(Corner));
		}
		Faces.emplace_back(Corners, Order);
	}
	// 2. Rays from above, below and the side: the nearest hit of all faces is the mesh's, to the bit.
	std::mt19937 Random(7);
	std::uniform_real_distribution<float> Coordinate(-200.0f, 2600.0f), Slope(-1.0f, 1.0f);
	int HitCount = 0;
	for (int Ray = 0; Ray < 400; ++Ray)
	{
		const FVector3f From(Coordinate(Random), Coordinate(Random), 400.0f * Slope(Random));
		const FVector3f Along = FVector3f(Slope(Random), Slope(Random), 0.3f * Slope(Random)).GetSafeNormal();
		FTerraportGroundPoint Best, Point;
		bool bAny = false;
		for (const FTerraportGroundMesh& Face : Faces)
		{
			if (Face.Cast(From, Along, 4000.0f, Point) && (!bAny || Point.At < Best.At))
			{
				Best = Point;
				bAny = true;
			}
		}
		const bool bMet = Ground.Cast(From, Along, 4000.0f, Point);
		CHECK(bMet == bAny);
		if (bMet && bAny)
		{
			CHECK(Point.At == Best.At);
			++HitCount;
		}
	}
	CHECK(HitCount > 50);
}

TEST_CASE("an empty mesh is met by nothing")
{
	FTerraportGroundPoint Point;
	CHECK_FALSE(FTerraportGroundMesh().Cast(FVector3f(), FVector3f(0.0f, 0.0f, 1.0f), 1e6f, Point));
}
