#pragma once

#include "Materials/MaterialInterface.h"

// Its values are in MaterialDomain.h, which comes along up to 5.1 alone.
#include "Misc/EngineVersionComparison.h"
#if UE_VERSION_OLDER_THAN(5, 2, 0)
#include "MaterialDomain.h"
#else
enum EMaterialDomain : int;
#endif

class UMaterial : public UMaterialInterface
{
public:
	static UMaterial* GetDefaultMaterial(EMaterialDomain)
	{
		static UMaterial Default;
		return &Default;
	}
};
