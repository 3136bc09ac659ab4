#include "TerraportBaseOrder.h"

#include <algorithm>
#include <cstddef>

namespace TerraportBaseOrder
{
namespace
{
struct Centre
{
	float At[3];
};

/// Sort `Order[Begin, End)` into leaves of `BlockFaces` faces that lie close together; the last leaf may have fewer.
///
/// Invariant: the ranges in `Open` are disjoint, and each begins a whole number of leaves behind `Begin`.
void Split(std::vector<std::uint32_t>& Order, const std::vector<Centre>& Centres, std::size_t Begin, std::size_t End,
	std::uint32_t BlockFaces)
{
	// An explicit list instead of recursion: depth is then no matter, whatever the base.
	struct Range
	{
		std::size_t Begin, End;
	};
	std::vector<Range> Open{{Begin, End}};
	while (!Open.empty())
	{
		const Range Current = Open.back();
		Open.pop_back();
		const std::size_t Count = Current.End - Current.Begin;
		// 1. A leaf keeps the order of the file within itself.
		if (Count <= BlockFaces)
		{
			std::sort(Order.begin() + std::ptrdiff_t(Current.Begin), Order.begin() + std::ptrdiff_t(Current.End));
			continue;
		}
		// 2. The longest side of the box around the centres.
		float Least[3] = {
			Centres[Order[Current.Begin]].At[0], Centres[Order[Current.Begin]].At[1], Centres[Order[Current.Begin]].At[2]};
		float Most[3] = {Least[0], Least[1], Least[2]};
		for (std::size_t Slot = Current.Begin; Slot < Current.End; ++Slot)
		{
			for (int Axis = 0; Axis < 3; ++Axis)
			{
				const float At = Centres[Order[Slot]].At[Axis];
				Least[Axis] = std::min(Least[Axis], At);
				Most[Axis] = std::max(Most[Axis], At);
			}
		}
		int Longest = 0;
		for (int Axis = 1; Axis < 3; ++Axis)
		{
			if (Most[Axis] - Least[Axis] > Most[Longest] - Least[Longest])
			{
				Longest = Axis;
			}
		}
		// 3. Cut across it near the middle, on a multiple of the leaf's size, so that leaves stay whole.
		const std::size_t Blocks = (Count + BlockFaces - 1) / BlockFaces;
		const std::size_t Cut = Current.Begin + Blocks / 2 * BlockFaces;
		// Ties go by the face's number: no two faces are equal, so the outcome is one.
		std::nth_element(Order.begin() + std::ptrdiff_t(Current.Begin), Order.begin() + std::ptrdiff_t(Cut),
			Order.begin() + std::ptrdiff_t(Current.End), [&Centres, Longest](std::uint32_t A, std::uint32_t B) {
				const float AtA = Centres[A].At[Longest], AtB = Centres[B].At[Longest];
				return AtA != AtB ? AtA < AtB : A < B;
			});
		Open.push_back({Cut, Current.End});
		Open.push_back({Current.Begin, Cut});
	}
}
} // namespace

std::vector<std::uint32_t> OrderFaces(
	const float* Positions, const std::uint32_t* Indices, std::size_t FaceCount, std::uint32_t BlockFaces)
{
	std::vector<std::uint32_t> Order(FaceCount);
	std::vector<Centre> Centres(FaceCount);
	for (std::size_t Face = 0; Face < FaceCount; ++Face)
	{
		Order[Face] = std::uint32_t(Face);
		for (int Axis = 0; Axis < 3; ++Axis)
		{
			float Sum = 0.0f;
			for (int Corner = 0; Corner < 3; ++Corner)
			{
				Sum += Positions[3 * std::size_t(Indices[3 * Face + std::size_t(Corner)]) + std::size_t(Axis)];
			}
			Centres[Face].At[Axis] = Sum / 3.0f;
		}
	}
	Split(Order, Centres, 0, FaceCount, std::max(BlockFaces, 1u));
	return Order;
}

bool Reorder(terraport::SceneFiles& Files, std::uint32_t BlockFaces)
{
	terraport::SegmentMesh& Base = Files.base;
	const std::size_t FaceCount = Base.faceCount;
	if (Files.cover.faceCount() != FaceCount || Base.indices.size() != 3 * FaceCount)
	{
		return false;
	}
	std::vector<float> Positions(3 * std::size_t(Base.vertexCount));
	Base.writePositions(Positions.data());
	const std::vector<std::uint32_t> Order = OrderFaces(Positions.data(), Base.indices.data(), FaceCount, BlockFaces);

	std::vector<std::uint32_t> Indices(3 * FaceCount);
	terraport::Cover Cover;
	Cover.offsets.reserve(FaceCount + 1);
	Cover.segments.reserve(Files.cover.segments.size());
	Cover.offsets.push_back(0);
	for (std::size_t Slot = 0; Slot < FaceCount; ++Slot)
	{
		const std::size_t Face = Order[Slot];
		std::copy_n(Base.indices.data() + 3 * Face, 3, Indices.data() + 3 * Slot);
		Cover.segments.insert(Cover.segments.end(), Files.cover.segments.begin() + std::ptrdiff_t(Files.cover.offsets[Face]),
			Files.cover.segments.begin() + std::ptrdiff_t(Files.cover.offsets[Face + 1]));
		Cover.offsets.push_back(std::uint32_t(Cover.segments.size()));
	}
	std::copy(Indices.begin(), Indices.end(), Base.indices.begin());
	Files.cover = std::move(Cover);
	return true;
}
} // namespace TerraportBaseOrder
