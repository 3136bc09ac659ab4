#include "Modules/ModuleManager.h"
#include "TerraportLog.h"
#include "TerraportSocketThread.h"

DEFINE_LOG_CATEGORY(LogTerraport)

class FTerraportModule final : public FDefaultModuleImpl
{
public:
	/** Early (see LoadingPhase in Terraport.uplugin), since whoever loads WebSockets first fixes the pace of its thread. */
	virtual void StartupModule() override { TerraportSocketThread::Prepare(); }
};

IMPLEMENT_MODULE(FTerraportModule, Terraport)
