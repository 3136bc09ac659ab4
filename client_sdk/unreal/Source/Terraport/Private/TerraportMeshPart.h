#pragma once

#include "CoreMinimal.h"

#include "Core/Ground.h"
#include "Core/Scene.h"
#include "Core/Stage.h"
#include "TerraportGroundPiece.h"
#include "TerraportSettings.h"
#include "TerraportTexture.h"

#include <vector>

/** One mesh in Unreal's axes: a segment, or the base. Centimetres about the scene's origin. Touches no UObject. */
struct FTerraportMeshPart
{
	TArray<FVector3f> Positions;
	/** Unit, one for each position. */
	TArray<FVector3f> Normals;
	/** One for each position, or empty. */
	TArray<FColor> Colours;
	/** One for each position, or empty; (0, 0) is the image's upper left corner. */
	TArray<FVector2f> Uvs;
	/** Three for each face. */
	TArray<uint32> Indices;
	FBox3f Bounds = FBox3f(ForceInit);

	/**
	 * All of a mesh, with its image in Pixels. An image that cannot be read is replaced by the mean colour of the regions
	 * (`bUnread`).
	 */
	void Build(const terraport::SegmentMesh& Mesh, terraport::ByteSpan Payload, const std::vector<terraport::Region>& Regions,
		ETerraportVertexColours Coding, FTerraportPixels& Pixels, bool& bUnread);

	/** Some faces, with the vertices that they use. */
	FTerraportMeshPart Cut(const std::vector<uint32>& Faces) const;
};

/** A segment that was decoded on a worker thread, ready to be uploaded. */
class FTerraportPreparedSegment final : public terraport::PreparedSegment
{
public:
	TSharedPtr<FTerraportGroundPiece, ESPMode::ThreadSafe> Piece;
	/** Empty without an image, and once it was uploaded. */
	FTerraportPixels Pixels;
	bool bUnread = false;
};

/** The base, cut into blocks of faces that lie together; shared between the worker that makes it and the renderer. */
struct FTerraportBase
{
	struct FBlock
	{
		/** Numbers of its faces in the base. */
		std::vector<uint32> Faces;
		FTerraportMeshPart Part;
	};

	std::vector<FBlock> Blocks;
	terraport::SharedGround Ground;
	FTerraportPixels Pixels;
	bool bUnread = false;
	double PushBackM = 0.0;

	static TSharedRef<FTerraportBase, ESPMode::ThreadSafe> Build(const terraport::Scene& Scene, ETerraportVertexColours Coding);
};
