#pragma once

#include "CoreMinimal.h"

#include "Core/Stage.h"
#include "TerraportSettings.h"

#include <memory>

/**
 * Decodes on the engine's task threads, and makes there what the graphics take: the game thread is left with components. At
 * most `MaxTasks` at a time.
 */
class FTerraportDecodes final : public terraport::Decoder
{
public:
	/** `Disk` is kept by whatever still decodes. */
	FTerraportDecodes(std::shared_ptr<terraport::DiskCache> Disk, ETerraportVertexColours Colours, int32 MaxTasks);
	/** Does not wait: what is being decoded ends by itself, and is thrown away. */
	virtual ~FTerraportDecodes() override;
	FTerraportDecodes(const FTerraportDecodes&) = delete;
	FTerraportDecodes& operator=(const FTerraportDecodes&) = delete;

	virtual void push(terraport::DecodeJob Job) override;
	virtual bool tryPop(terraport::DecodeResult& Result) override;

private:
	struct FShared;
	static void Work(const TSharedRef<FShared, ESPMode::ThreadSafe>& Shared);

	TSharedRef<FShared, ESPMode::ThreadSafe> Shared;
};
