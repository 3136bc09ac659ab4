#pragma once

#include "CoreMinimal.h"

#include "Terraport/SceneFiles.h"
#include "Terraport/Status.h"
#include "TerraportMeshBuilder.h"
#include "TerraportSettings.h"

#include <memory>
#include <string>

/** Which scene to load, and how its base is cut. A value: the worker that builds the base outlives who asked. */
struct FTerraportFilesRequest
{
	/** A scene's, or a server's that has one scene alone. */
	std::string Url;
	std::string Token;
	/** Of the scene; empty for the newest. */
	std::string Version;
	uint32 BlockFaces = 2048;
	ETerraportVertexColours Colours = ETerraportVertexColours::Srgb;
};

/** Outcome of a load: files and base, or why there are none. */
struct FTerraportFilesResult
{
	terraport::Status Status;
	/** `.../scenes/{id}`, for the stream. */
	std::string SceneUrl;
	/** Null where the status is a failure. */
	terraport::SharedSceneFiles Files;
	TSharedPtr<FTerraportBase, ESPMode::ThreadSafe> Base;
};

/**
 * Manifest, base and cover of a scene: fetched by the engine's HTTP, checked, decoded, put into order and cut into blocks on a
 * task thread. Game thread; destroying it cancels what is under way.
 */
class FTerraportFiles
{
public:
	explicit FTerraportFiles(const FTerraportFilesRequest& Request);
	~FTerraportFiles();
	FTerraportFiles(const FTerraportFiles&) = delete;
	FTerraportFiles& operator=(const FTerraportFiles&) = delete;

	/** Go on; true once, when it is over, whichever way. */
	bool Poll(FTerraportFilesResult& Result);

private:
	struct FImpl;
	std::unique_ptr<FImpl> Impl;
};
