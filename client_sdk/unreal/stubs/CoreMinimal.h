// Stand-ins for exactly those declarations of Unreal Engine 5.4 to 5.8 that the modules Terraport and TerraportSample use, so
// that they can be compiled, and their engine-free logic tested, without the engine. Written from Epic's API reference; see
// README.md for where each signature was looked up. Nothing here is Epic's code.
#pragma once

#include "StubContainers.h"
#include "StubMath.h"
#include "StubObjects.h"
#include "StubTypes.h"
