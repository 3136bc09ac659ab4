#include "TerraportScene.h"

#include "Components/SceneComponent.h"
#include "Engine/World.h"
#include "Materials/MaterialInterface.h"
#include "TerraportAxes.h"
#include "TerraportDynamicBackend.h"
#include "TerraportGroundBackend.h"
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

terraport::Vec3 DirectionOf(const AActor& Actor, const FVector& WorldDirection)
{
	const FVector Local = Actor.GetActorTransform().InverseTransformVectorNoScale(WorldDirection);
	const double Unreal[3] = {Local.X, Local.Y, Local.Z};
	double Scene[3];
	TerraportAxes::DirectionToScene(Unreal, Scene);
	return terraport::Vec3{Scene[0], Scene[1], Scene[2]};
}

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
		if (Options.DeadlineMs > 0)
		{
			Out.deadlineMs = uint32(Options.DeadlineMs);
		}
		if (Options.StallMs > 0)
		{
			Out.stallMs = uint32(Options.StallMs);
		}
	}
	return Out;
}

ETerraportLandingPhase PhaseOf(terraport::LandingPhase Phase)
{
	switch (Phase)
	{
	case terraport::LandingPhase::Planning:
		return ETerraportLandingPhase::Planning;
	case terraport::LandingPhase::Loading:
		return ETerraportLandingPhase::Loading;
	case terraport::LandingPhase::PresentableDegraded:
		return ETerraportLandingPhase::PresentableDegraded;
	case terraport::LandingPhase::Presentable:
		return ETerraportLandingPhase::Presentable;
	case terraport::LandingPhase::ShownDegraded:
		return ETerraportLandingPhase::ShownDegraded;
	case terraport::LandingPhase::Shown:
		return ETerraportLandingPhase::Shown;
	case terraport::LandingPhase::Refused:
		return ETerraportLandingPhase::Refused;
	case terraport::LandingPhase::None:
		break;
	}
	return ETerraportLandingPhase::None;
}

FTerraportGroundHit HitOf(const AActor& Actor, const terraport::GroundPoint& Point)
{
	FTerraportGroundHit Hit;
	Hit.Location = WorldOf(Actor, Point.position);
	const double Scene[3] = {Point.normal.x, Point.normal.y, Point.normal.z};
	double Unreal[3];
	TerraportAxes::DirectionToUnreal(Scene, Unreal);
	Hit.Normal = Actor.GetActorTransform().TransformVectorNoScale(FVector(Unreal[0], Unreal[1], Unreal[2]));
	Hit.DistanceCm = Point.at * TerraportAxes::CentimetresPerMetre;
	Hit.Segment = int32(Point.segment);
	return Hit;
}

/** Raises a session's events as the scene's. */
class FSceneHost final : public ITerraportSessionHost
{
public:
	explicit FSceneHost(ATerraportScene& InScene) : Scene(InScene) {}

	virtual FString GetSceneUrl() const override { return Scene.SceneUrl; }
	virtual double GetFrameBudgetMs() const override { return double(Scene.FrameBudgetMs); }
	virtual bool IsAutoShow() const override { return Scene.bAutoShow; }
	virtual bool ShowsCoarse() const override { return Scene.bShowsCoarse; }

	virtual void OnOpened() override { Scene.OnOpened.Broadcast(); }
	virtual void OnLink(const FTerraportLink& Link) override { Scene.OnLink.Broadcast(Link); }
	virtual void OnPlan(const FTerraportPlan& Plan) override { Scene.OnPlan.Broadcast(Plan); }
	virtual void OnReady(const FTerraportReady& Ready) override { Scene.OnReady.Broadcast(Ready); }
	virtual void OnDegraded(int64 Landing) override { Scene.OnDegraded.Broadcast(Landing); }
	virtual void OnPresentable(int64 Landing) override { Scene.OnPresentable.Broadcast(Landing); }
	virtual void OnShown(const FTerraportSwap& Swap) override { Scene.OnShown.Broadcast(Swap); }
	virtual void OnFailed(const FTerraportFailure& Failure) override { Scene.OnFailed.Broadcast(Failure); }
	virtual void OnPicked(const FTerraportPick& Pick) override { Scene.OnPicked.Broadcast(Pick); }

private:
	/** Owns the session, which owns this. */
	ATerraportScene& Scene;
};

FTerraportSessionSettings SettingsOf(const ATerraportScene& Scene)
{
	FTerraportSessionSettings Settings;
	Settings.Token = TerraportText::ToUtf8(Scene.Token);
	Settings.Budgets = Scene.Device == ETerraportDevice::Custom ? Scene.CustomBudgets : FTerraportBudgets::For(Scene.Device);
	Settings.DecodeTasks = Scene.DecodeTasks;
	Settings.Mesh.bCollision = Scene.bCollision;
	Settings.Mesh.bCastShadow = Scene.bCastShadows || Scene.bLit;
	Settings.bLit = Scene.bLit;
	Settings.Materials.Colour = Scene.ColourMaterial;
	Settings.Materials.Texture = Scene.TextureMaterial;
	Settings.Materials.BaseColour = Scene.BaseColourMaterial;
	Settings.Materials.BaseTexture = Scene.BaseTextureMaterial;
	Settings.Materials.TextureParameter = Scene.TextureParameter;
	Settings.Materials.PushParameter = Scene.PushParameter;
	Settings.VertexColours = Scene.VertexColours;
	return Settings;
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
	TSharedPtr<ITerraportMeshBackend, ESPMode::ThreadSafe> Backend = CustomBackend;
	if (!Backend.IsValid())
	{
		// Packed meshes have nothing in main memory that collision could be cooked from.
		if (Meshes == ETerraportMeshes::Dynamic || bCollision)
		{
			Backend = MakeShared<FTerraportDynamicBackend, ESPMode::ThreadSafe>();
		}
		else
		{
			Backend = MakeShared<FTerraportGroundBackend, ESPMode::ThreadSafe>();
		}
	}
	if (!GetActorScale3D().Equals(FVector(1.0, 1.0, 1.0)))
	{
		UE_LOG(LogTerraport, Warning, TEXT("%s has a scale other than 1: radii and heights will be wrong"), *GetName());
	}
	FTerraportSessionSettings SessionSettings = SettingsOf(*this);
	if (TokenProvider.IsBound())
	{
		SessionSettings.TokenProvider = [Provider = TokenProvider, Fixed = SessionSettings.Token]() {
			return Provider.IsBound() ? TerraportText::ToUtf8(Provider.Execute()) : Fixed;
		};
	}
	Session = MakeShared<FTerraportSession>(
		*this, std::make_unique<FSceneHost>(*this), SessionSettings, ReferencedObjects, Backend.ToSharedRef());
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
		Session->Reconnect(TerraportText::ToUtf8(NewToken));
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
	return Session->Pick(ScenePointOf(*this, WorldOrigin), DirectionOf(*this, WorldDirection));
}

bool ATerraportScene::Show()
{
	const TSharedPtr<FTerraportSession> Current = Session;
	return Current.IsValid() && Current->Show();
}

bool ATerraportScene::CastGround(
	const FVector& WorldStart, const FVector& WorldDirection, double MaxDistanceCm, FTerraportGroundHit& Hit) const
{
	const terraport::ShownGround* Ground = Session.IsValid() ? Session->GetGround() : nullptr;
	if (Ground == nullptr || WorldStart.ContainsNaN() || WorldDirection.ContainsNaN() || !(MaxDistanceCm > 0.0))
	{
		return false;
	}
	terraport::GroundPoint Point;
	const double ReachM = MaxDistanceCm / TerraportAxes::CentimetresPerMetre;
	const terraport::Vec3 Along = DirectionOf(*this, WorldDirection.GetSafeNormal());
	if (!Ground->cast(ScenePointOf(*this, WorldStart), Along, ReachM, Point))
	{
		return false;
	}
	Hit = HitOf(*this, Point);
	return true;
}

bool ATerraportScene::GroundAt(const FVector& WorldLocation, FTerraportGroundHit& Hit) const
{
	const terraport::ShownGround* Ground = Session.IsValid() ? Session->GetGround() : nullptr;
	terraport::GroundPoint Point;
	if (Ground == nullptr || WorldLocation.ContainsNaN() || !Ground->groundAt(ScenePointOf(*this, WorldLocation), Point))
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
	const terraport::SceneStage* Stage = Session.IsValid() ? Session->GetStage() : nullptr;
	if (Stage != nullptr)
	{
		const terraport::LandingStatus CoreStatus = Stage->status();
		Status.Phase = PhaseOf(CoreStatus.phase);
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
	const terraport::SceneStage* Stage = Session.IsValid() ? Session->GetStage() : nullptr;
	FBox Box(ForceInit);
	if (Stage != nullptr)
	{
		const terraport::Vec3& Least = Stage->files().manifest.boundsMin;
		const terraport::Vec3& Most = Stage->files().manifest.boundsMax;
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
	const terraport::SceneStage* Stage = Session.IsValid() ? Session->GetStage() : nullptr;
	if (Stage == nullptr)
	{
		return false;
	}
	const terraport::Vec3 Survey = terraport::toSurvey(Stage->files().manifest, ScenePointOf(*this, WorldLocation));
	EastNorthHeightM = FVector(Survey.x, Survey.y, Survey.z);
	return true;
}

bool ATerraportScene::SurveyToWorld(const FVector& EastNorthHeightM, FVector& WorldLocation) const
{
	const terraport::SceneStage* Stage = Session.IsValid() ? Session->GetStage() : nullptr;
	if (Stage == nullptr)
	{
		return false;
	}
	const terraport::Vec3 Survey{EastNorthHeightM.X, EastNorthHeightM.Y, EastNorthHeightM.Z};
	WorldLocation = WorldOf(*this, terraport::fromSurvey(Stage->files().manifest, Survey));
	return true;
}

void ATerraportScene::SetMeshBackend(TSharedPtr<ITerraportMeshBackend, ESPMode::ThreadSafe> Backend)
{
	CustomBackend = Backend;
}
