#pragma once

#include "DynamicMesh/DynamicMesh3.h"

namespace UE::Geometry
{
template <typename T>
class TDynamicMeshVectorOverlay
{
public:
	int AppendElement(const T& Value)
	{
		StubElements.push_back(Value);
		return int(StubElements.size()) - 1;
	}
	int SetTriangle(int, const FIndex3i& Elements)
	{
		StubTriangles.push_back(Elements);
		return 0;
	}
	std::vector<T> StubElements;
	std::vector<FIndex3i> StubTriangles;
};

class FDynamicMeshAttributeSet
{
public:
	void EnablePrimaryColors() {}
	TDynamicMeshVectorOverlay<FVector3f>* PrimaryNormals() { return &Normals; }
	TDynamicMeshVectorOverlay<FVector2f>* PrimaryUV() { return &Uvs; }
	TDynamicMeshVectorOverlay<FVector4f>* PrimaryColors() { return &Colours; }

private:
	TDynamicMeshVectorOverlay<FVector3f> Normals;
	TDynamicMeshVectorOverlay<FVector2f> Uvs;
	TDynamicMeshVectorOverlay<FVector4f> Colours;
};

inline void FDynamicMesh3::EnableAttributes()
{
	StubAttributes = std::make_shared<FDynamicMeshAttributeSet>();
}
} // namespace UE::Geometry
