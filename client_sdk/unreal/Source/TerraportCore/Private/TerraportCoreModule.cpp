// The only file of this module that knows the engine. Outside Unreal it is empty.
#if defined(TERRAPORT_UNREAL)

#include "Modules/ModuleManager.h"

IMPLEMENT_MODULE(FDefaultModuleImpl, TerraportCore)

#endif
