// What crosses the border of the module TerraportCore carries TERRAPORTCORE_API. Unreal's build tool defines it; elsewhere
// it is nothing.
#pragma once

#ifdef TERRAPORTCORE_API
// The build tool defines it as DLLEXPORT or DLLIMPORT, which are themselves macros of this header (and nothing is, in a
// program of one piece). It also sets which warnings the engine cares about. It is the only header of the engine here.
#include "HAL/Platform.h"
#else
#define TERRAPORTCORE_API
#endif
