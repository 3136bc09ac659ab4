// What a GPU would not notice: numbers of vertices that are not there, normals without length, positions at infinity.
#pragma once

#include "Terraport/SegmentMesh.h"
#include "Terraport/Status.h"

namespace terraport {

/// Sets `maxIndex`, and looks whether every face uses vertices that are there.
Status checkIndices(SegmentMesh& mesh);

/// Whether no normal has length 0, and none of float is NaN or infinite.
Status checkNormals(const SegmentMesh& mesh);

/// Sets `bounds`, and looks whether every position is finite.
Status placeBounds(SegmentMesh& mesh);

/// Whether texture coordinates lie in the image.
Status checkUvs(const SegmentMesh& mesh);

}  // namespace terraport
