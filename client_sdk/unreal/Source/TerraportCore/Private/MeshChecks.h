// What a GPU would not notice: numbers of vertices that are not there, normals without length, positions at infinity.
#pragma once

#include "Terraport/SegmentMesh.h"
#include "Terraport/Status.h"

namespace terraport {

/// Set `maxIndex`; damaged where a face names a vertex beyond `vertexCount`.
Status checkIndices(SegmentMesh& mesh);

/// Damaged where a normal has length 0.
Status checkNormals(const SegmentMesh& mesh);

/// Set `bounds`, metres in the scene's frame; damaged where a position is not finite.
Status computeBounds(SegmentMesh& mesh);

/// Damaged where a texture coordinate lies outside the image.
Status checkUvs(const SegmentMesh& mesh);

}  // namespace terraport
