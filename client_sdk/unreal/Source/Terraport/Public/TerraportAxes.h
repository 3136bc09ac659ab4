#pragma once

#include <cmath>
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

/// A unit normal from signed bytes, of which 127 is 1. One of no length points up.
inline void NormalToUnreal(const std::int8_t Codes[3], float Out[3])
{
	const float Scene[3] = {float(Codes[0]), float(Codes[1]), float(Codes[2])};
	const float Length = std::sqrt(Scene[0] * Scene[0] + Scene[1] * Scene[1] + Scene[2] * Scene[2]);
	DirectionToUnreal(Scene, Out);
	for (int Axis = 0; Axis < 3; ++Axis)
	{
		Out[Axis] = Length > 0.0f ? Out[Axis] / Length : (Axis == 2 ? 1.0f : 0.0f);
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
