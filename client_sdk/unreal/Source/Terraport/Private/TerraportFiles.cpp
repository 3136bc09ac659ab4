#include "TerraportFiles.h"

#include "Tasks/Task.h"
#include "Terraport/SceneLoader.h"
#include "TerraportBaseOrder.h"
#include "TerraportHttp.h"

#include <functional>
#include <utility>

namespace
{
/** What the worker makes, written before the loader is done and read after. */
struct FTerraportWorkerResult
{
	TSharedPtr<FTerraportBase, ESPMode::ThreadSafe> Base;
};

terraport::SceneLoadOptions OptionsOf(
	const FTerraportFilesRequest& Request, const std::shared_ptr<FTerraportWorkerResult>& WorkerResult)
{
	terraport::SceneLoadOptions Options;
	Options.token = Request.Token;
	Options.version = Request.Version;
	Options.runElsewhere = [](std::function<void()> Work) {
		UE::Tasks::Launch(TEXT("TerraportFiles"), std::move(Work), UE::Tasks::ETaskPriority::BackgroundNormal);
	};
	Options.afterLoad = [WorkerResult, BlockFaces = Request.BlockFaces, Colours = Request.Colours](
							terraport::SceneFiles& Files) {
		// Unsorted the base is drawn as well, only with more blocks to change; the loader has checked that the cover fits.
		(void)TerraportBaseOrder::Reorder(Files, BlockFaces);
		WorkerResult->Base = FTerraportBase::Build(Files, BlockFaces, Colours);
	};
	return Options;
}
} // namespace

struct FTerraportFiles::FImpl
{
	explicit FImpl(const FTerraportFilesRequest& Request)
		: WorkerResult(std::make_shared<FTerraportWorkerResult>()), Loader(Http, Request.Url, OptionsOf(Request, WorkerResult))
	{
	}

	FTerraportHttp Http;
	std::shared_ptr<FTerraportWorkerResult> WorkerResult;
	terraport::SceneLoader Loader;
	bool bReported = false;
};

FTerraportFiles::FTerraportFiles(const FTerraportFilesRequest& Request) : Impl(std::make_unique<FImpl>(Request)) {}

FTerraportFiles::~FTerraportFiles() = default;

bool FTerraportFiles::Poll(FTerraportFilesResult& Result)
{
	if (Impl->bReported || Impl->Loader.pump() == terraport::LoadState::Loading)
	{
		return false;
	}
	Impl->bReported = true;
	Result.Status = Impl->Loader.status();
	Result.SceneUrl = Impl->Loader.sceneUrl();
	if (Impl->Loader.state() == terraport::LoadState::Done)
	{
		Result.Files = Impl->Loader.files();
		Result.Base = Impl->WorkerResult->Base;
	}
	return true;
}
