#pragma once

// The version that the stubs stand for; -DSTUB_ENGINE_MINOR=4 compiles the branches for older engines.
#ifndef STUB_ENGINE_MINOR
#define STUB_ENGINE_MINOR 8
#endif
#define UE_VERSION_OLDER_THAN(Major, Minor, Patch) (5 < (Major) || (5 == (Major) && STUB_ENGINE_MINOR < (Minor)))
