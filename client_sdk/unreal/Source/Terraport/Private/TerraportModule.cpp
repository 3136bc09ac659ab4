#include "Modules/ModuleManager.h"
#include "TerraportLog.h"

DEFINE_LOG_CATEGORY(LogTerraport)

IMPLEMENT_MODULE(FDefaultModuleImpl, Terraport)
