#pragma once

#include "CoreMinimal.h"

#include "Terraport/SceneFiles.h"
#include "Terraport/SegmentMesh.h"
#include "Terraport/ShownGround.h"
#include "TerraportMeshBackend.h"
#include "TerraportSettings.h"
#include "TerraportTexture.h"

#include <cstdint>
#include <vector>

/** Decoded payloads to mesh parts in Unreal's axes. For worker threads: touches no UObject. */
namespace TerraportMeshBuilder
{
/** All of a mesh. What `Part` held before is replaced, its memory used again. */
void BuildPart(const terraport::SegmentMesh& Mesh, ETerraportVertexColours Colours, FTerraportMeshPart& Part);

/** Mean sRGB colour of the regions of a mesh's vertices; of all regions by area where it does not say which, and a light grey
 * where they have no colour. */
FColor MeanColourOf(const terraport::SegmentMesh& Mesh, const std::vector<terraport::RegionFacts>& Regions);

/** Draw a part in one colour in place of an image. */
void FillColour(FColor Srgb, ETerraportVertexColours Coding, FTerraportMeshPart& Part);

/** Faces `First ... First + Count - 1` of a mesh that was turned into `Whole`, with the vertices that they use. */
void CutPart(const FTerraportMeshPart& Whole, uint32 First, uint32 Count, FTerraportMeshPart& Part);
} // namespace TerraportMeshBuilder

/** What decoding makes of a segment, kept with the decoder's own buffers. */
class FTerraportSegmentData final : public terraport::EngineData
{
public:
	/** Made on the worker; null once the renderer has made a component of it. */
	TUniquePtr<FTerraportPreparedMesh> Prepared;
	/** For rays; null once the renderer has it. */
	terraport::SharedGround Ground;
	/** Empty where the payload has no image, or one that the engine cannot read. */
	FTerraportPixels Pixels;
	/** The kind of image that could not be read; None otherwise. */
	terraport::ImageType Unread = terraport::ImageType::None;
	int32 Vertices = 0;
	int32 Indices = 0;
	/** Kept between payloads for its memory; nobody reads it after Build. */
	FTerraportMeshPart Part;

	/** Fill all of it from a mesh that was decoded just now. `Regions`: the scene's, whose colours stand for an image that
	 * cannot be read; may be empty. */
	void Build(const terraport::SegmentMesh& Mesh, terraport::ByteSpan Payload, const ITerraportMeshBackend& Backend,
		ETerraportVertexColours Colours, const std::vector<terraport::RegionFacts>& Regions);
};

/** The base, cut into blocks of consecutive faces; shared between the worker that makes it and the renderer. */
struct FTerraportBase
{
	uint32 BlockFaces = 0;
	std::vector<FTerraportMeshPart> Blocks;
	/** For rays: the whole. */
	terraport::SharedGround Ground;
	FTerraportPixels Pixels;
	/** As a segment's. */
	terraport::ImageType Unread = terraport::ImageType::None;

	/** Of files whose faces were put into order. */
	static TSharedRef<FTerraportBase, ESPMode::ThreadSafe> Build(
		const terraport::SceneFiles& Files, uint32 BlockFaces, ETerraportVertexColours Colours);
};
