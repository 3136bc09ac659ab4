#pragma once

#include "CoreMinimal.h"

#include "Terraport/DecodeQueue.h"
#include "TerraportMeshBackend.h"
#include "TerraportSettings.h"

/**
 * Decodes payloads on the engine's task threads, turns axes there, and makes of the mesh what the backend takes: the game
 * thread is left with making components. At most `MaxTasks` at a time.
 */
class FTerraportDecodes final : public terraport::DecodeQueue
{
public:
	/** `Backend` is kept alive by whatever still decodes. */
	FTerraportDecodes(
		TSharedRef<ITerraportMeshBackend, ESPMode::ThreadSafe> Backend, ETerraportVertexColours Colours, int32 MaxTasks);
	/** Does not wait: what is being decoded ends by itself, and is thrown away. */
	virtual ~FTerraportDecodes() override;
	FTerraportDecodes(const FTerraportDecodes&) = delete;
	FTerraportDecodes& operator=(const FTerraportDecodes&) = delete;

	virtual void push(terraport::DecodeJob Job) override;
	virtual bool tryPop(terraport::DecodedSegment& Out) override;
	virtual void release(std::unique_ptr<terraport::SegmentMesh> Mesh) override;

private:
	struct FShared;
	static void Work(const TSharedRef<FShared, ESPMode::ThreadSafe>& Shared);

	TSharedRef<FShared, ESPMode::ThreadSafe> Shared;
};
