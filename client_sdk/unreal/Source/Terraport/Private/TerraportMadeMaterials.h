#pragma once

#include "CoreMinimal.h"

/** Paths of the materials that Content/Python/terraport_materials.py makes in a project. */
namespace TerraportMadeMaterials
{
/** In fours, unlit before lit: colour, texture, base colour, base texture. */
constexpr const TCHAR* Paths[] = {
	TEXT("/Game/Terraport/M_TerraportColour.M_TerraportColour"),
	TEXT("/Game/Terraport/M_TerraportTexture.M_TerraportTexture"),
	TEXT("/Game/Terraport/M_TerraportBaseColour.M_TerraportBaseColour"),
	TEXT("/Game/Terraport/M_TerraportBaseTexture.M_TerraportBaseTexture"),
	TEXT("/Game/Terraport/M_TerraportLitColour.M_TerraportLitColour"),
	TEXT("/Game/Terraport/M_TerraportLitTexture.M_TerraportLitTexture"),
	TEXT("/Game/Terraport/M_TerraportLitBaseColour.M_TerraportLitBaseColour"),
	TEXT("/Game/Terraport/M_TerraportLitBaseTexture.M_TerraportLitBaseTexture"),
};
constexpr int32 FirstLit = 4;
} // namespace TerraportMadeMaterials
