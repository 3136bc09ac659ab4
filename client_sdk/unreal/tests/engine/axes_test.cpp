#include "TerraportAxes.h"

#include <doctest/doctest.h>

#include <cstring>

namespace
{
/// Cross product of a face's sides in the order of its corners: outwards, in a right-handed frame.
void OutwardsInScene(const float A[3], const float B[3], const float C[3], float Out[3])
{
	const float U[3] = {B[0] - A[0], B[1] - A[1], B[2] - A[2]};
	const float V[3] = {C[0] - A[0], C[1] - A[1], C[2] - A[2]};
	Out[0] = U[1] * V[2] - U[2] * V[1];
	Out[1] = U[2] * V[0] - U[0] * V[2];
	Out[2] = U[0] * V[1] - U[1] * V[0];
}
} // namespace

TEST_CASE("east, up and south become X, Z and Y, in centimetres")
{
	const double Scene[3] = {1.0, 2.0, 3.0};
	double Unreal[3];
	TerraportAxes::PointToUnreal(Scene, Unreal);
	CHECK(Unreal[0] == 100.0);
	CHECK(Unreal[1] == 300.0);
	CHECK(Unreal[2] == 200.0);
	double Back[3];
	TerraportAxes::PointToScene(Unreal, Back);
	CHECK(Back[0] == 1.0);
	CHECK(Back[1] == 2.0);
	CHECK(Back[2] == 3.0);
	const float Up[3] = {0.0f, 1.0f, 0.0f};
	float UpInUnreal[3];
	TerraportAxes::DirectionToUnreal(Up, UpInUnreal);
	CHECK(UpInUnreal[2] == 1.0f);
}

TEST_CASE("points may be changed in place")
{
	double Point[3] = {1.0, 2.0, 3.0};
	TerraportAxes::PointToUnreal(Point, Point);
	CHECK(Point[1] == 300.0);
	CHECK(Point[2] == 200.0);
}

TEST_CASE("a face keeps its front: outwards in the scene is the renderer's front, with the corners in the same order")
{
	// Level ground seen from above, and two walls.
	const float Faces[3][9] = {{0, 0, 0, 0, 0, 1, 1, 0, 0}, {0, 0, 0, 1, 0, 0, 0, 1, 0}, {0, 0, 0, 0, 1, 0, 0, 0, 1}};
	for (const auto& Face : Faces)
	{
		float Outwards[3], Expected[3], Corners[9], Front[3];
		OutwardsInScene(Face, Face + 3, Face + 6, Outwards);
		TerraportAxes::DirectionToUnreal(Outwards, Expected);
		TerraportAxes::PositionsToUnreal(Face, 3, Corners);
		TerraportAxes::FrontOfFace(Corners, Corners + 3, Corners + 6, Front);
		for (int Axis = 0; Axis < 3; ++Axis)
		{
			CHECK(Front[Axis] == doctest::Approx(Expected[Axis] * 10000.0f));
		}
	}
}

TEST_CASE("a border vertex of two segments is the same to the bit, whatever their translations")
{
	const float Step = 1.0f / 128.0f;
	const float OffsetA[3] = {1203.5f, -17.25f, -3999.0078125f};
	const float OffsetB[3] = {OffsetA[0] - 411 * Step, OffsetA[1] + 90 * Step, OffsetA[2] - 65000 * Step};
	for (std::uint16_t Code = 500; Code < 600; ++Code)
	{
		const std::uint16_t CodesA[4] = {Code, 200, 77, 0};
		const std::uint16_t CodesB[4] = {std::uint16_t(Code + 411), std::uint16_t(200 - 90), std::uint16_t(77 + 65000), 0};
		float PositionA[3], PositionB[3];
		TerraportAxes::PositionsToUnreal(CodesA, 1, OffsetA, Step, PositionA);
		TerraportAxes::PositionsToUnreal(CodesB, 1, OffsetB, Step, PositionB);
		CHECK(std::memcmp(PositionA, PositionB, sizeof(PositionA)) == 0);
	}
}

TEST_CASE("normals are unit, and one without length points up")
{
	const std::int8_t Normals[8] = {0, 126, 3, 0, 0, 0, 0, 0};
	float Out[6];
	TerraportAxes::NormalsToUnreal(Normals, 2, Out);
	CHECK(Out[0] * Out[0] + Out[1] * Out[1] + Out[2] * Out[2] == doctest::Approx(1.0f));
	CHECK(Out[2] > 0.99f);
	CHECK(Out[1] > 0.0f);
	CHECK(Out[5] == 1.0f);
}

TEST_CASE("texture coordinates keep V")
{
	const std::uint16_t Codes[2] = {512, 1024};
	const float Scale[2] = {1.0f / 2048.0f, 1.0f / 2048.0f};
	float Uv[2];
	TerraportAxes::UvsToUnreal(Codes, 1, Scale, Uv);
	CHECK(Uv[0] == 0.25f);
	CHECK(Uv[1] == 0.5f);
}
