#pragma once

#include "Materials/MaterialInterface.h"

enum EMaterialDomain
{
	MD_Surface
};

class UMaterial : public UMaterialInterface
{
public:
	static UMaterial* GetDefaultMaterial(EMaterialDomain)
	{
		static UMaterial Default;
		return &Default;
	}
};
