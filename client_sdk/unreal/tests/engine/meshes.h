#pragma once

#include "Terraport/SceneFiles.h"
#include "Terraport/SegmentMesh.h"

#include <cmath>
#include <cstdint>

/// A level grid of `Side` x `Side` squares of a metre, faces up, vertices in rows; each vertex has its own grey.
inline void MakeGrid(std::uint32_t Side, terraport::SegmentMesh& Mesh)
{
	// 1. Room for everything.
	const std::uint32_t Row = Side + 1;
	Mesh.clear();
	Mesh.vertexCount = Row * Row;
	Mesh.faceCount = 2 * Side * Side;
	Mesh.positionForm = terraport::VertexForm::Codes;
	Mesh.stepM = 0.5;
	Mesh.hasColours = true;
	bool bRoom = Mesh.positionCodes.resize(4 * Mesh.vertexCount) && Mesh.normalCodes.resize(4 * Mesh.vertexCount) &&
		Mesh.colours.resize(4 * Mesh.vertexCount) && Mesh.indices.resize(3 * Mesh.faceCount);
	if (!bRoom)
	{
		return;
	}
	// 2. Vertices: two steps of half a metre apart, y up.
	for (std::uint32_t Vertex = 0; Vertex < Mesh.vertexCount; ++Vertex)
	{
		const std::uint16_t Codes[4] = {std::uint16_t(2 * (Vertex % Row)), 0, std::uint16_t(2 * (Vertex / Row)), 0};
		const std::int8_t Normal[4] = {0, 127, 0, 0};
		for (std::size_t At = 0; At < 4; ++At)
		{
			Mesh.positionCodes[4 * Vertex + At] = Codes[At];
			Mesh.normalCodes[4 * Vertex + At] = Normal[At];
			Mesh.colours[4 * Vertex + At] = At == 3 ? 255 : std::uint8_t(Vertex * 255u / Mesh.vertexCount);
		}
	}
	// 3. Two faces a square, counter-clockwise seen from above.
	std::size_t Index = 0;
	for (std::uint32_t Z = 0; Z < Side; ++Z)
	{
		for (std::uint32_t X = 0; X < Side; ++X)
		{
			const std::uint32_t A = Z * Row + X, B = A + 1, C = A + Row, D = C + 1;
			for (const std::uint32_t Corner : {A, C, B, B, C, D})
			{
				Mesh.indices[Index] = Corner;
				++Index;
			}
		}
	}
	Mesh.bounds = terraport::Box{0.0f, 0.0f, 0.0f, float(Side), 0.0f, float(Side)};
}

/// A scene whose base is such a grid, in shuffled face order; face f lies under segment f % 7, every fifth under none.
inline void MakeScene(std::uint32_t Side, terraport::SceneFiles& Files)
{
	MakeGrid(Side, Files.base);
	Files.manifest.version = "00000000000000000000000000000001";
	Files.manifest.deviationM = 0.25;
	Files.manifest.baseFaces = Files.base.faceCount;
	// A fixed permutation: face f goes to (f * 7919) mod F, F being prime to 7919 for the sides that are used.
	const std::size_t Faces = Files.base.faceCount;
	std::vector<std::uint32_t> Shuffled(3 * Faces);
	for (std::size_t Face = 0; Face < Faces; ++Face)
	{
		for (std::size_t Corner = 0; Corner < 3; ++Corner)
		{
			Shuffled[3 * (Face * 7919 % Faces) + Corner] = Files.base.indices[3 * Face + Corner];
		}
	}
	std::copy(Shuffled.begin(), Shuffled.end(), Files.base.indices.begin());
	Files.cover.offsets.push_back(0);
	for (std::uint32_t Face = 0; Face < Faces; ++Face)
	{
		if (Face % 5 != 0)
		{
			Files.cover.segments.push_back(Face % 7);
			Files.cover.segments.push_back(7 + Face % 3);
		}
		Files.cover.offsets.push_back(std::uint32_t(Files.cover.segments.size()));
	}
}
