#pragma once

#include "CoreMinimal.h"

#include <map>

namespace UE::Geometry
{
struct FIndex3i
{
	int A = -1, B = -1, C = -1;
	FIndex3i(int InA, int InB, int InC) : A(InA), B(InB), C(InC) {}
};

class FDynamicMeshAttributeSet;

/// Vertices, and triangles of which two at most meet at an edge.
class FDynamicMesh3
{
public:
	FDynamicMesh3() = default;
	FDynamicMesh3(FDynamicMesh3&&) = default;
	FDynamicMesh3& operator=(FDynamicMesh3&&) = default;
	void EnableAttributes();
	FDynamicMeshAttributeSet* Attributes() { return StubAttributes.get(); }
	int AppendVertex(const FVector3d& Position)
	{
		StubVertices.push_back(Position);
		return int(StubVertices.size()) - 1;
	}
	/// The triangle's number; negative where the mesh does not take it.
	int AppendTriangle(const FIndex3i& Corners, int = 0)
	{
		const int At[3] = {Corners.A, Corners.B, Corners.C};
		for (int Edge = 0; Edge < 3; ++Edge)
		{
			if (Edges[std::minmax(At[Edge], At[(Edge + 1) % 3])] >= 2)
			{
				return -2;
			}
		}
		for (int Edge = 0; Edge < 3; ++Edge)
		{
			++Edges[std::minmax(At[Edge], At[(Edge + 1) % 3])];
		}
		StubTriangles.push_back(Corners);
		return int(StubTriangles.size()) - 1;
	}
	std::vector<FVector3d> StubVertices;
	std::vector<FIndex3i> StubTriangles;

private:
	std::map<std::pair<int, int>, int> Edges;
	std::shared_ptr<FDynamicMeshAttributeSet> StubAttributes;
};
} // namespace UE::Geometry

#include "DynamicMesh/DynamicMeshAttributeSet.h"
