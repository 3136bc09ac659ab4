#include "TerraportSession.h"

#include "GameFramework/Actor.h"
#include "MaterialDomain.h"
#include "Materials/Material.h"
#include "TerraportLog.h"
#include "TerraportMadeMaterials.h"

// What draws, where the scene's properties choose no material.

namespace
{
/** What terraport_materials.py made in this project; null where it was not run. */
UMaterialInterface* Made(const TCHAR* Path)
{
	return LoadObject<UMaterialInterface>(nullptr, Path);
}

UMaterialInterface* Or(UMaterialInterface* Chosen, UMaterialInterface* Substitute)
{
	return Chosen != nullptr ? Chosen : Substitute;
}

FTerraportMaterials MadeMaterials(bool bLit)
{
	const TCHAR* const* Paths = TerraportMadeMaterials::Paths + (bLit ? TerraportMadeMaterials::FirstLit : 0);
	FTerraportMaterials Materials;
	Materials.Colour = Made(Paths[0]);
	Materials.Texture = Made(Paths[1]);
	Materials.BaseColour = Made(Paths[2]);
	Materials.BaseTexture = Made(Paths[3]);
	return Materials;
}
} // namespace

/** Each that is chosen; else the one that the script made; else the textured as the plain ones, the base's as the detail's. */
FTerraportMaterials FTerraportSession::MaterialsOf(const FTerraportMaterials& Chosen, bool bLit)
{
	const FTerraportMaterials Found = MadeMaterials(bLit);
	FTerraportMaterials Materials = Chosen;
	Materials.Colour = Or(Chosen.Colour, Found.Colour);
	if (Chosen.Colour == nullptr)
	{
		// The script's material decodes sRGB; the engine's takes bytes as they are.
		Colours = Found.Colour != nullptr ? ETerraportVertexColours::Srgb : ETerraportVertexColours::Linear;
	}
	if (Materials.Colour == nullptr)
	{
		Materials.Colour = Made(TEXT("/Engine/EngineDebugMaterials/VertexColorMaterial.VertexColorMaterial"));
		// Debug materials may be missing from a packaged game.
		Materials.Colour = Or(Materials.Colour, UMaterial::GetDefaultMaterial(MD_Surface));
	}
	Materials.Texture = Or(Or(Chosen.Texture, Found.Texture), Materials.Colour);
	Materials.BaseColour = Or(Or(Chosen.BaseColour, Found.BaseColour), Materials.Colour);
	Materials.BaseTexture = Or(Or(Chosen.BaseTexture, Found.BaseTexture), Materials.Texture);
	if (Or(Or(Chosen.BaseColour, Found.BaseColour), Or(Chosen.BaseTexture, Found.BaseTexture)) == nullptr)
	{
		UE_LOG(LogTerraport, Warning,
			TEXT("%s has no base material, and none was found in /Game/Terraport: the base is not pushed back, and may poke "
				 "through "
				 "detail at the rim; the editor makes the materials when it starts with the Python Editor Script Plugin (see "
				 "docs/how-to/unreal.md)"),
			*Owner.GetName());
	}
	return Materials;
}
