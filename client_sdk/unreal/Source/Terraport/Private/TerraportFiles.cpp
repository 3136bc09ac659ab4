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
struct FTerraportMade
{
	TSharedPtr<FTerraportBase, ESPMode::ThreadSafe> Base;
};

terraport::SceneLoadOptions OptionsOf(const FTerraportFilesRequest& Request, const std::shared_ptr<FTerraportMade>& Made)
{
	terraport::SceneLoadOptions Options;
	Options.token = Request.Token;
	Options.version = Request.Version;
	Options.runElsewhere = [](std::function<void()> Work) {
		UE::Tasks::Launch(TEXT("TerraportFiles"), std::move(Work), UE::Tasks::ETaskPriority::BackgroundNormal);
	};
	Options.afterLoad = [Made, BlockFaces = Request.BlockFaces, Colours = Request.Colours](terraport::SceneFiles& Files) {
		// Unsorted the base is drawn as well, only with more blocks to change; the loader has checked that the cover fits.
		(void)TerraportBaseOrder::Reorder(Files, BlockFaces);
		Made->Base = FTerraportBase::Build(Files, BlockFaces, Colours);
	};
	return Options;
}
} // namespace

struct FTerraportFiles::FImpl
{
	explicit FImpl(const FTerraportFilesRequest& Request)
		: Made(std::make_shared<FTerraportMade>()), Loader(Http, Request.Url, OptionsOf(Request, Made))
	{
	}

	FTerraportHttp Http;
	std::shared_ptr<FTerraportMade> Made;
	terraport::SceneLoader Loader;
	bool bTold = false;
};

FTerraportFiles::FTerraportFiles(const FTerraportFilesRequest& Request) : Impl(std::make_unique<FImpl>(Request)) {}

FTerraportFiles::~FTerraportFiles() = default;

bool FTerraportFiles::Poll(FTerraportFilesResult& Result)
{
	if (Impl->bTold || Impl->Loader.pump() == terraport::LoadState::Loading)
	{
		return false;
	}
	Impl->bTold = true;
	Result.Status = Impl->Loader.status();
	Result.SceneUrl = Impl->Loader.sceneUrl();
	if (Impl->Loader.state() == terraport::LoadState::Done)
	{
		Result.Files = Impl->Loader.files();
		Result.Base = Impl->Made->Base;
	}
	return true;
}
