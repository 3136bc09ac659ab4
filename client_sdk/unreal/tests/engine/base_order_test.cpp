#include "TerraportBaseOrder.h"
#include "meshes.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <map>
#include <vector>

namespace
{
using FRows = std::map<std::array<std::uint32_t, 3>, std::vector<std::uint32_t>>;

/// The cover's row of each face, by the face's corners.
FRows RowsOf(const terraport::SceneFiles& Files)
{
	FRows Rows;
	for (std::size_t Face = 0; Face < Files.base.faceCount; ++Face)
	{
		const std::uint32_t* Corners = Files.base.indices.data() + 3 * Face;
		Rows[{Corners[0], Corners[1], Corners[2]}] =
			std::vector<std::uint32_t>(Files.cover.segments.begin() + Files.cover.offsets[Face],
				Files.cover.segments.begin() + Files.cover.offsets[Face + 1]);
	}
	return Rows;
}

/// Mean area of the boxes of blocks of consecutive faces.
double MeanBox(const terraport::SceneFiles& Files, std::size_t BlockFaces)
{
	std::vector<float> Positions(3 * std::size_t(Files.base.vertexCount));
	Files.base.writePositions(Positions.data());
	double Sum = 0.0;
	std::size_t Blocks = 0;
	for (std::size_t First = 0; First < Files.base.faceCount; First += BlockFaces, ++Blocks)
	{
		float Least[2] = {1e9f, 1e9f}, Most[2] = {-1e9f, -1e9f};
		const std::size_t End = std::min<std::size_t>(First + BlockFaces, Files.base.faceCount);
		for (std::size_t Index = 3 * First; Index < 3 * End; ++Index)
		{
			const float* At = Positions.data() + 3 * std::size_t(Files.base.indices[Index]);
			Least[0] = std::min(Least[0], At[0]);
			Least[1] = std::min(Least[1], At[2]);
			Most[0] = std::max(Most[0], At[0]);
			Most[1] = std::max(Most[1], At[2]);
		}
		Sum += double(Most[0] - Least[0]) * double(Most[1] - Least[1]);
	}
	return Sum / double(Blocks);
}
} // namespace

TEST_CASE("every face keeps its row of the cover, and blocks become compact")
{
	terraport::SceneFiles Files;
	MakeScene(40, Files);
	const FRows Before = RowsOf(Files);
	const double BoxBefore = MeanBox(Files, 100);
	REQUIRE(TerraportBaseOrder::Reorder(Files, 100));
	CHECK(RowsOf(Files) == Before);
	CHECK(Files.cover.faceCount() == Files.base.faceCount);
	// 3,200 faces in 32 blocks over 1,600 square metres: 50 each at best.
	CHECK(BoxBefore > 1000.0);
	CHECK(MeanBox(Files, 100) < 80.0);
}

TEST_CASE("blocks are whole but for the last, and the order is the same each time")
{
	terraport::SegmentMesh Mesh;
	MakeGrid(11, Mesh);
	std::vector<float> Positions(3 * std::size_t(Mesh.vertexCount));
	Mesh.writePositions(Positions.data());
	const std::vector<std::uint32_t> Order =
		TerraportBaseOrder::OrderFaces(Positions.data(), Mesh.indices.data(), Mesh.faceCount, 50);
	CHECK(Order == TerraportBaseOrder::OrderFaces(Positions.data(), Mesh.indices.data(), Mesh.faceCount, 50));
	std::vector<std::uint32_t> Sorted = Order;
	std::sort(Sorted.begin(), Sorted.end());
	for (std::uint32_t Face = 0; Face < Mesh.faceCount; ++Face)
	{
		CHECK(Sorted[Face] == Face);
	}
	for (std::size_t First = 0; First < Order.size(); First += 50)
	{
		const std::size_t End = std::min<std::size_t>(First + 50, Order.size());
		CHECK(std::is_sorted(Order.begin() + std::ptrdiff_t(First), Order.begin() + std::ptrdiff_t(End)));
	}
}

TEST_CASE("files whose cover does not fit are left alone")
{
	terraport::SceneFiles Files;
	MakeScene(4, Files);
	Files.cover.offsets.pop_back();
	const std::vector<std::uint32_t> Offsets = Files.cover.offsets;
	CHECK_FALSE(TerraportBaseOrder::Reorder(Files, 10));
	CHECK(Files.cover.offsets == Offsets);
}

TEST_CASE("a base without a face is no trouble")
{
	CHECK(TerraportBaseOrder::OrderFaces(nullptr, nullptr, 0, 10).empty());
}
