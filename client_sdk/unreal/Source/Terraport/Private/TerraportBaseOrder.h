#pragma once

#include "Terraport/SceneFiles.h"

#include <cstdint>
#include <vector>

/// The order of the base's faces, for engines that draw it in pieces.
///
/// The stage prepares the base in blocks of consecutive faces. In the file they are in the vertex cache's order: a block of
/// 2,048 faces of a quarry of 199,220 has a bounding box eight times as large as it need be, so that a landing changes nearly
/// every block. Sorted into the leaves of a k-d tree over their centres, consecutive faces lie together, and a landing of 60 m
/// changes few. Plain C++, no engine type.
namespace TerraportBaseOrder
{
/// Order in which faces `0 ... indexCount / 3 - 1` are to stand: every `BlockFaces` consecutive ones are one leaf (the last
/// is smaller). `Positions` has three floats a vertex. The same input gives the same order; faces of a leaf keep theirs.
/// O(F log^2 F); a base of 200,000 faces takes a twentieth of a second.
std::vector<std::uint32_t> OrderFaces(
	const float* Positions, const std::uint32_t* Indices, std::size_t FaceCount, std::uint32_t BlockFaces);

/// Put faces and the cover's rows into that order, together: row f stays the row of face f. False (and nothing is changed)
/// where memory is short, or the cover has another number of rows than the base has faces.
bool Reorder(terraport::SceneFiles& Files, std::uint32_t BlockFaces);
} // namespace TerraportBaseOrder
