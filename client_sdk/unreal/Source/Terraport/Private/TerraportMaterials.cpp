#include "MaterialDomain.h"
#include "Materials/Material.h"
#include "TerraportLog.h"
#include "TerraportMadeMaterials.h"
#include "TerraportRenderer.h"

namespace
{
/** Null where there is none. */
UMaterialInterface* Load(const TCHAR* Path)
{
	return LoadObject<UMaterialInterface>(nullptr, Path);
}

UMaterialInterface* Or(UMaterialInterface* Chosen, UMaterialInterface* Substitute)
{
	return Chosen != nullptr ? Chosen : Substitute;
}
} // namespace

FTerraportMaterials FTerraportMaterials::Find(const FTerraportMaterials& Chosen, bool bLit, const FString& SceneName)
{
	const TCHAR* const* Paths = TerraportMadeMaterials::Paths + (bLit ? TerraportMadeMaterials::FirstLit : 0);
	UMaterialInterface* const MadeColour = Load(Paths[0]);
	FTerraportMaterials Found = Chosen;
	Found.Colour = Or(Chosen.Colour, MadeColour);
	if (Chosen.Colour == nullptr)
	{
		// The script's material decodes sRGB; the engine's takes bytes as they are.
		Found.Coding = MadeColour != nullptr ? ETerraportVertexColours::Srgb : ETerraportVertexColours::Linear;
	}
	if (Found.Colour == nullptr)
	{
		Found.Colour = Load(TEXT("/Engine/EngineDebugMaterials/VertexColorMaterial.VertexColorMaterial"));
		// Debug materials may be missing from a packaged game.
		Found.Colour = Or(Found.Colour, UMaterial::GetDefaultMaterial(MD_Surface));
	}
	Found.Texture = Or(Or(Chosen.Texture, Load(Paths[1])), Found.Colour);
	UMaterialInterface* const BaseColour = Or(Chosen.BaseColour, Load(Paths[2]));
	UMaterialInterface* const BaseTexture = Or(Chosen.BaseTexture, Load(Paths[3]));
	Found.BaseColour = Or(BaseColour, Found.Colour);
	Found.BaseTexture = Or(BaseTexture, Found.Texture);
	if (Or(BaseColour, BaseTexture) == nullptr)
	{
		UE_LOG(LogTerraport, Warning,
			TEXT("%s has no base material, and /Game/Terraport has none: the base is not pushed back, and may show through "
				 "detail at the rim; the editor makes the materials when it starts with the Python Editor Script Plugin (see "
				 "docs/how-to/unreal.md)"),
			*SceneName);
	}
	return Found;
}
