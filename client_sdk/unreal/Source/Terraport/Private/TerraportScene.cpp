#include "TerraportScene.h"

#include "Components/SceneComponent.h"
#include "Engine/World.h"
#include "Materials/MaterialInterface.h"
#include "TerraportAxes.h"
#include "TerraportLog.h"
#include "TerraportMadeMaterials.h"
#include "TerraportPlaces.h"
#include "TerraportSession.h"
#include "TerraportText.h"
#include "UObject/ConstructorHelpers.h"

#include <algorithm>
#include <cmath>
#include <memory>

namespace
{
using TerraportPlaces::ScenePointOf;
using TerraportPlaces::WorldOf;

using TerraportPlaces::SceneDirectionOf;

terraport::LandOptions OptionsOf(const FTerraportLandOptions& Options)
{
	terraport::LandOptions Out;
	if (Options.CoarseRadiusM > 0.0)
	{
		Out.coarseRadiusM = Options.CoarseRadiusM;
	}
	if (Options.InnerRadiusM > 0.0)
	{
		Out.innerRadiusM = Options.InnerRadiusM;
		Out.deadlineMs = double(Options.DeadlineMs);
		Out.stallMs = double(Options.StallMs);
	}
	return Out;
}

FTerraportGroundHit HitOf(const AActor& Actor, const terraport::GroundPoint& Point)
{
	FTerraportGroundHit Hit;
	Hit.Location = WorldOf(Actor, Point.position);
	Hit.Normal = TerraportPlaces::WorldDirectionOf(Actor, Point.normal);
	Hit.DistanceCm = Point.at * TerraportAxes::CentimetresPerMetre;
	Hit.Segment = int32(Point.segment);
	return Hit;
}

} // namespace

ATerraportScene::ATerraportScene()
{
	PrimaryActorTick.bCanEverTick = true;
	// A paused game still has to answer the server, or the connection is taken for dead.
	PrimaryActorTick.bTickEvenWhenPaused = true;
	Root = CreateDefaultSubobject<USceneComponent>(TEXT("Root"));
	SetRootComponent(Root);
	// The class's default alone; scenes inherit it. A project in which the editor has not made them yet has none.
	if (HasAnyFlags(RF_ClassDefaultObject))
	{
		for (const TCHAR* Path : TerraportMadeMaterials::Paths)
		{
			ConstructorHelpers::FObjectFinderOptional<UMaterialInterface> Found(Path, LOAD_NoWarn | LOAD_Quiet);
			if (Found.Succeeded())
			{
				MadeMaterials.Add(Found.Get());
			}
		}
	}
}

ATerraportScene::~ATerraportScene() = default;

void ATerraportScene::BeginPlay()
{
	Super::BeginPlay();
	if (bOpenOnBeginPlay)
	{
		Open();
	}
}

void ATerraportScene::EndPlay(const EEndPlayReason::Type EndPlayReason)
{
	Close();
	Super::EndPlay(EndPlayReason);
}

void ATerraportScene::BeginDestroy()
{
	// One that never began to play, but was opened, ends no play either. Later its components' memory may be gone.
	Close();
	Super::BeginDestroy();
}

void ATerraportScene::Tick(float DeltaSeconds)
{
	Super::Tick(DeltaSeconds);
	// A level's own viewport, not that of a Blueprint's or a thumbnail's world.
	const UWorld* World = GetWorld();
	if (World != nullptr && World->WorldType == EWorldType::Editor)
	{
		TickPreview();
	}
	TickSession();
}

void ATerraportScene::TickSession()
{
	// Keeps the session alive: a listener may close the scene from within an event.
	const TSharedPtr<FTerraportSession> Current = Session;
	if (Current.IsValid())
	{
		Current->Tick();
		if (IsValid(FeetOf))
		{
			const double ReachM = double(FeetReachCm) / TerraportAxes::CentimetresPerMetre;
			Current->StepFeet(ScenePointOf(*this, FeetOf->GetActorLocation()), ReachM, MaxFeetFaces);
		}
	}
}

void ATerraportScene::Open()
{
	Close();
	if (!GetActorScale3D().Equals(FVector(1.0, 1.0, 1.0)))
	{
		UE_LOG(LogTerraport, Warning, TEXT("%s has a scale other than 1: radii and heights will be wrong"), *GetName());
	}
	Session = MakeShared<FTerraportSession>(*this, TokenProvider, ReferencedObjects);
	if (bLandAtOpen)
	{
		bLandAtOpen = false;
		Session->Land(ScenePointOf(*this, OpenLocation), OpenRadiusM, OptionsOf(OpenOptions));
	}
}

void ATerraportScene::Close()
{
	const TSharedPtr<FTerraportSession> Last = Session;
	Session.Reset();
	if (Last.IsValid())
	{
		Last->End();
	}
}

void ATerraportScene::SetTokenProvider(FTerraportTokenProvider Provider)
{
	TokenProvider = Provider;
}

void ATerraportScene::Reconnect(const FString& NewToken)
{
	if (Session.IsValid())
	{
		Session->Reconnect(NewToken);
	}
}

int64 ATerraportScene::Land(const FVector& WorldLocation, double RadiusM, const FTerraportLandOptions& Options)
{
	if (WorldLocation.ContainsNaN() || !(RadiusM > 0.0) || !std::isfinite(RadiusM))
	{
		return -1;
	}
	if (!Session.IsValid())
	{
		// An actor that was spawned just now has not begun to play.
		bLandAtOpen = true;
		OpenLocation = WorldLocation;
		OpenRadiusM = RadiusM;
		OpenOptions = Options;
		return 0;
	}
	return Session->Land(ScenePointOf(*this, WorldLocation), RadiusM, OptionsOf(Options));
}

void ATerraportScene::Aim(const FVector& WorldLocation, double RadiusM)
{
	if (Session.IsValid() && !WorldLocation.ContainsNaN() && RadiusM > 0.0 && std::isfinite(RadiusM))
	{
		Session->Aim(ScenePointOf(*this, WorldLocation), RadiusM);
	}
}

int64 ATerraportScene::Pick(const FVector& WorldOrigin, const FVector& WorldDirection)
{
	if (!Session.IsValid() || WorldOrigin.ContainsNaN() || WorldDirection.ContainsNaN())
	{
		return -1;
	}
	return Session->Pick(ScenePointOf(*this, WorldOrigin), SceneDirectionOf(*this, WorldDirection));
}

bool ATerraportScene::Show()
{
	const TSharedPtr<FTerraportSession> Current = Session;
	return Current.IsValid() && Current->Show();
}

bool ATerraportScene::CastGround(
	const FVector& WorldStart, const FVector& WorldDirection, double MaxDistanceCm, FTerraportGroundHit& Hit) const
{
	const terraport::Stage* Stage = Session.IsValid() ? Session->GetStage() : nullptr;
	if (Stage == nullptr || WorldStart.ContainsNaN() || WorldDirection.ContainsNaN() || !(MaxDistanceCm > 0.0))
	{
		return false;
	}
	terraport::GroundPoint Point;
	const double ReachM = MaxDistanceCm / TerraportAxes::CentimetresPerMetre;
	const terraport::Vec3 Along = SceneDirectionOf(*this, WorldDirection.GetSafeNormal());
	if (!Stage->ground().cast(ScenePointOf(*this, WorldStart), Along, ReachM, Point))
	{
		return false;
	}
	Hit = HitOf(*this, Point);
	return true;
}

bool ATerraportScene::GroundAt(const FVector& WorldLocation, FTerraportGroundHit& Hit) const
{
	const terraport::Stage* Stage = Session.IsValid() ? Session->GetStage() : nullptr;
	terraport::GroundPoint Point;
	if (Stage == nullptr || WorldLocation.ContainsNaN() || !Stage->ground().groundAt(ScenePointOf(*this, WorldLocation), Point))
	{
		return false;
	}
	Hit = HitOf(*this, Point);
	return true;
}

bool ATerraportScene::IsOpen() const
{
	return Session.IsValid() && Session->GetStage() != nullptr;
}

FTerraportStatus ATerraportScene::GetStatus() const
{
	FTerraportStatus Status;
	const terraport::Stage* Stage = Session.IsValid() ? Session->GetStage() : nullptr;
	if (Stage != nullptr)
	{
		const terraport::LandingStatus CoreStatus = Stage->status();
		Status.Phase = ETerraportLandingPhase(CoreStatus.phase);
		Status.Landing = std::max<int64>(CoreStatus.landing, 0);
		Status.Fraction = CoreStatus.fraction;
		Status.ReadyMs = CoreStatus.readyMs;
		Status.PresentableMs = CoreStatus.presentableMs;
		Status.Refusal = TerraportText::FromUtf8(CoreStatus.refusal);
	}
	return Status;
}

FTerraportStats ATerraportScene::TakeStats()
{
	return Session.IsValid() ? Session->TakeStats() : FTerraportStats();
}

FBox ATerraportScene::GetSceneBounds() const
{
	const terraport::SharedScene Loaded = Session.IsValid() ? Session->GetScene() : nullptr;
	FBox Box(ForceInit);
	if (Loaded)
	{
		const terraport::Vec3& Least = Loaded->boundsMin;
		const terraport::Vec3& Most = Loaded->boundsMax;
		for (int32 Corner = 0; Corner < 8; ++Corner)
		{
			Box += WorldOf(*this,
				terraport::Vec3{(Corner & 1) != 0 ? Most.x : Least.x, (Corner & 2) != 0 ? Most.y : Least.y,
					(Corner & 4) != 0 ? Most.z : Least.z});
		}
	}
	return Box;
}

bool ATerraportScene::WorldToSurvey(const FVector& WorldLocation, FVector& EastNorthHeightM) const
{
	const terraport::SharedScene Loaded = Session.IsValid() ? Session->GetScene() : nullptr;
	if (!Loaded)
	{
		return false;
	}
	const terraport::Vec3 Survey = Loaded->toSurvey(ScenePointOf(*this, WorldLocation));
	EastNorthHeightM = FVector(Survey.x, Survey.y, Survey.z);
	return true;
}

bool ATerraportScene::SurveyToWorld(const FVector& EastNorthHeightM, FVector& WorldLocation) const
{
	const terraport::SharedScene Loaded = Session.IsValid() ? Session->GetScene() : nullptr;
	if (!Loaded)
	{
		return false;
	}
	const terraport::Vec3 Survey{EastNorthHeightM.X, EastNorthHeightM.Y, EastNorthHeightM.Z};
	WorldLocation = WorldOf(*this, Loaded->fromSurvey(Survey));
	return true;
}
