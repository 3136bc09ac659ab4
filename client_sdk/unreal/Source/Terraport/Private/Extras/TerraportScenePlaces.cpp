#include "TerraportScene.h"

#include "Core/Extras/Places.h"
#include "TerraportAxes.h"
#include "TerraportSession.h"
#include "TerraportText.h"

// Named regions and coarser pieces, in the types of Blueprint.

namespace
{
/** Yaw of the axes' X, which is east, where headings count from north. */
constexpr double EastDeg = 90.0;

FTerraportPlace PlaceOf(const terraport::NamedPlace& Place, const FTransform& Frame)
{
	const double Scene[3] = {Place.position.x, Place.position.y, Place.position.z};
	double Unreal[3];
	TerraportAxes::PointToUnreal(Scene, Unreal);
	FTerraportPlace Out;
	Out.Label = TerraportText::FromUtf8(Place.label);
	Out.Region = int32(Place.region);
	Out.AreaM2 = Place.areaM2.value_or(0.0);
	Out.Location = Frame.TransformPosition(FVector(Unreal[0], Unreal[1], Unreal[2]));
	Out.YawDegrees = Place.headingDeg.value_or(0.0) - EastDeg + Frame.Rotator().Yaw;
	Out.RadiusM = Place.radiusM;
	Out.bIsView = Place.isView;
	return Out;
}
} // namespace

TArray<FTerraportPlace> ATerraportScene::GetPlaces() const
{
	TArray<FTerraportPlace> Places;
	const terraport::SharedScene Loaded = Session.IsValid() ? Session->GetScene() : nullptr;
	if (Loaded)
	{
		for (const terraport::NamedPlace& Place : terraport::placesOf(Loaded->regions))
		{
			Places.Add(PlaceOf(Place, GetActorTransform()));
		}
	}
	return Places;
}

bool ATerraportScene::FindPlace(const FString& Name, FTerraportPlace& Place) const
{
	const terraport::SharedScene Loaded = Session.IsValid() ? Session->GetScene() : nullptr;
	if (!Loaded)
	{
		return false;
	}
	const std::vector<terraport::NamedPlace> Places = terraport::placesOf(Loaded->regions);
	const terraport::NamedPlace* Found = terraport::findPlace(Places, TerraportText::ToUtf8(Name));
	if (Found == nullptr)
	{
		return false;
	}
	Place = PlaceOf(*Found, GetActorTransform());
	return true;
}

TArray<FTerraportCoarserPiece> ATerraportScene::GetCoarserPieces(int32 Region) const
{
	TArray<FTerraportCoarserPiece> Pieces;
	const terraport::SharedScene Loaded = Session.IsValid() ? Session->GetScene() : nullptr;
	if (!Loaded || Region < 0)
	{
		return Pieces;
	}
	for (const terraport::CoarserPiece& Piece : terraport::coarserPieces(Loaded->regions, Loaded->unions, uint32(Region)))
	{
		FTerraportCoarserPiece Out;
		Out.Label = TerraportText::FromUtf8(Piece.label);
		for (const std::uint32_t Member : Piece.regions)
		{
			Out.Regions.Add(int32(Member));
		}
		Out.AreaM2 = Piece.areaM2;
		Out.Cost = Piece.cost;
		Pieces.Add(Out);
	}
	return Pieces;
}
