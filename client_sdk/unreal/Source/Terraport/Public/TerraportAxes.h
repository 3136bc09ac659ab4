#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

/// The one place where axes and units change: scene frame <-> Unreal.
///
/// The scene frame is right-handed, in metres: x east, y up, z south. Unreal is left-handed, in centimetres: X east, Y south,
/// Z up (the axes of Epic's GeoReferencing and of Cesium for Unreal). So
///
///     (X, Y, Z) = 100 * (x, z, y)
///
/// which exchanges two axes: a reflection. **Corners keep their order.** The scene's faces are counter-clockwise seen from
/// outside, by the right-handed rule: cross(b - a, c - a) points outwards. After a reflection the same arithmetic points
/// inwards, and that is what Unreal's renderer calls a front face (docs/decisions/engine-rendering.md). Texture coordinates
/// stay, too: (0, 0) is the image's upper left corner on both sides.
///
/// Plain arithmetic, nothing of the engine: tests and tools compile this file alone.
namespace TerraportAxes
{
constexpr float CentimetresPerMetre = 100.0f;

/// A position of the scene frame, metres, in Unreal's component space, centimetres. `Out` may be `Scene`.
template <typename Real>
inline void PointToUnreal(const Real Scene[3], Real Out[3])
{
	const Real X = Scene[0], Y = Scene[1], Z = Scene[2];
	Out[0] = Real(CentimetresPerMetre) * X;
	Out[1] = Real(CentimetresPerMetre) * Z;
	Out[2] = Real(CentimetresPerMetre) * Y;
}

/// The inverse of PointToUnreal. `Out` may be `Unreal`.
template <typename Real>
inline void PointToScene(const Real Unreal[3], Real Out[3])
{
	const Real X = Unreal[0], Y = Unreal[1], Z = Unreal[2];
	Out[0] = X / Real(CentimetresPerMetre);
	Out[1] = Z / Real(CentimetresPerMetre);
	Out[2] = Y / Real(CentimetresPerMetre);
}

/// A direction or normal of the scene frame; its length stays. The way back is the same exchange.
template <typename Real>
inline void DirectionToUnreal(const Real Scene[3], Real Out[3])
{
	const Real X = Scene[0], Y = Scene[1], Z = Scene[2];
	Out[0] = X;
	Out[1] = Z;
	Out[2] = Y;
}

/// The inverse of DirectionToUnreal.
template <typename Real>
inline void DirectionToScene(const Real Unreal[3], Real Out[3])
{
	DirectionToUnreal(Unreal, Out);
}

/// Positions of `Count` vertices from the grid: four codes a vertex (the fourth is padding) to three floats, centimetres.
///
/// `Translation + StepM * code` is exact in float32 (scene format, section 4), and one multiplication by 100 rounds equal
/// positions equally: border vertices that two segments share stay equal to the bit, whatever their translations. That is why
/// nothing is left to a component's transform.
inline void PositionsToUnreal(
	const std::uint16_t* Codes, std::size_t Count, const float Translation[3], float StepM, float* Out)
{
	for (std::size_t Vertex = 0; Vertex < Count; ++Vertex)
	{
		const std::uint16_t* Code = Codes + 4 * Vertex;
		const float Scene[3] = {Translation[0] + StepM * float(Code[0]), Translation[1] + StepM * float(Code[1]),
			Translation[2] + StepM * float(Code[2])};
		PointToUnreal(Scene, Out + 3 * Vertex);
	}
}

/// Positions of `Count` vertices from floats of the scene frame, three each.
inline void PositionsToUnreal(const float* Positions, std::size_t Count, float* Out)
{
	for (std::size_t Vertex = 0; Vertex < Count; ++Vertex)
	{
		PointToUnreal(Positions + 3 * Vertex, Out + 3 * Vertex);
	}
}

/// Unit normals of `Count` vertices from signed bytes, four a vertex (the fourth is padding). A normal of no length points up.
inline void NormalsToUnreal(const std::int8_t* Normals, std::size_t Count, float* Out)
{
	for (std::size_t Vertex = 0; Vertex < Count; ++Vertex)
	{
		const std::int8_t* Normal = Normals + 4 * Vertex;
		const float Scene[3] = {float(Normal[0]), float(Normal[1]), float(Normal[2])};
		const float Length = std::sqrt(Scene[0] * Scene[0] + Scene[1] * Scene[1] + Scene[2] * Scene[2]);
		float* Unit = Out + 3 * Vertex;
		DirectionToUnreal(Scene, Unit);
		for (int Axis = 0; Axis < 3; ++Axis)
		{
			Unit[Axis] = Length > 0.0f ? Unit[Axis] / Length : (Axis == 2 ? 1.0f : 0.0f);
		}
	}
}

/// Texture coordinates of `Count` vertices: two codes and a scale for each axis. V stays as it is.
inline void UvsToUnreal(const std::uint16_t* Codes, std::size_t Count, const float Scale[2], float* Out)
{
	for (std::size_t Vertex = 0; Vertex < Count; ++Vertex)
	{
		Out[2 * Vertex] = Scale[0] * float(Codes[2 * Vertex]);
		Out[2 * Vertex + 1] = Scale[1] * float(Codes[2 * Vertex + 1]);
	}
}

/// Corners of `Count` indices. A copy: see the head of the file.
inline void IndicesToUnreal(const std::uint32_t* Indices, std::size_t Count, std::uint32_t* Out)
{
	for (std::size_t Index = 0; Index < Count; ++Index)
	{
		Out[Index] = Indices[Index];
	}
}

/// Outward normal of a face by Unreal's rule, not of unit length: what the renderer takes for its front.
inline void FrontOfFace(const float A[3], const float B[3], const float C[3], float Out[3])
{
	const float U[3] = {C[0] - A[0], C[1] - A[1], C[2] - A[2]};
	const float V[3] = {B[0] - A[0], B[1] - A[1], B[2] - A[2]};
	Out[0] = U[1] * V[2] - U[2] * V[1];
	Out[1] = U[2] * V[0] - U[0] * V[2];
	Out[2] = U[0] * V[1] - U[1] * V[0];
}
} // namespace TerraportAxes
