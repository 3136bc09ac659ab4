#include "TerraportUserComponent.h"

#include "Camera/CameraComponent.h"
#include "Camera/PlayerCameraManager.h"
#include "CollisionQueryParams.h"
#include "Engine/World.h"
#include "EngineUtils.h"
#include "GameFramework/Actor.h"
#include "GameFramework/Pawn.h"
#include "GameFramework/PlayerController.h"
#include "TerraportScene.h"

namespace
{
/** A hand above the target: the ground that comes may lie a little higher than the base that was aimed at. */
constexpr double SearchAboveCm = 200.0;
} // namespace

UTerraportUserComponent::UTerraportUserComponent()
{
	PrimaryComponentTick.bCanEverTick = true;
}

int64 UTerraportUserComponent::Land(const FVector& WorldLocation)
{
	ATerraportScene* ActiveScene = FindScene();
	return ActiveScene != nullptr ? ActiveScene->Land(WorldLocation, RadiusM, Options) : -1;
}

void UTerraportUserComponent::Aim(const FVector& WorldLocation)
{
	if (ATerraportScene* ActiveScene = FindScene())
	{
		ActiveScene->Aim(WorldLocation, RadiusM);
	}
}

bool UTerraportUserComponent::TryAim(
	const FVector& WorldStart, const FVector& WorldDirection, double MaxDistanceCm, FTerraportGroundHit& Hit)
{
	ATerraportScene* ActiveScene = FindScene();
	if (ActiveScene == nullptr || !ActiveScene->CastGround(WorldStart, WorldDirection, MaxDistanceCm, Hit) ||
		IsObstructed(WorldStart, Hit.Location))
	{
		return false;
	}
	ActiveScene->Aim(Hit.Location, RadiusM);
	return true;
}

bool UTerraportUserComponent::IsObstructed(const FVector& WorldStart, const FVector& WorldEnd) const
{
	const UWorld* World = GetWorld();
	if (World == nullptr || Obstacles.Num() == 0)
	{
		return false;
	}
	FCollisionQueryParams Parameters;
	Parameters.AddIgnoredActor(GetOwner());
	// Its bodies, around feet or everywhere, are ground.
	Parameters.AddIgnoredActor(Scene.Get());
	return World->LineTraceTestByObjectType(WorldStart, WorldEnd, FCollisionObjectQueryParams(Obstacles), Parameters);
}

bool UTerraportUserComponent::TeleportTo(const FVector& WorldLocation, float YawDegrees)
{
	return Teleport(WorldLocation, YawDegrees, RadiusM);
}

bool UTerraportUserComponent::TeleportToPlace(const FString& Name)
{
	const ATerraportScene* ActiveScene = FindScene();
	FTerraportPlace Place;
	if (ActiveScene == nullptr || !ActiveScene->FindPlace(Name, Place))
	{
		return false;
	}
	double Turn = 0.0;
	if (const AActor* Actor = Place.bIsView ? GetOwner() : nullptr)
	{
		// The head looks where the actor does, and beside.
		const UCameraComponent* Camera = Actor->FindComponentByClass<UCameraComponent>();
		Turn = Place.YawDegrees - (Camera != nullptr ? Camera->GetComponentRotation().Yaw : Actor->GetActorRotation().Yaw);
	}
	return Teleport(Place.Location, float(Turn), Place.RadiusM);
}

bool UTerraportUserComponent::Teleport(const FVector& WorldLocation, float YawDegrees, double LandingRadiusM)
{
	ATerraportScene* ActiveScene = FindScene();
	if (ActiveScene == nullptr || !ActiveScene->IsOpen() || WorldLocation.ContainsNaN())
	{
		return false;
	}
	const int64 NewLanding = ActiveScene->Land(WorldLocation, LandingRadiusM, Options);
	if (NewLanding < 0)
	{
		return false;
	}
	Landing = NewLanding;
	Target = WorldLocation;
	TargetYaw = YawDegrees;
	if (Phase == EPhase::Idle || Phase == EPhase::Lightening)
	{
		bSceneAutoShow = ActiveScene->bAutoShow;
	}
	// The swap is to fall into the dark.
	ActiveScene->bAutoShow = false;
	if (Phase == EPhase::Idle || Phase == EPhase::Lightening)
	{
		Enter(EPhase::Darkening);
	}
	return true;
}

bool UTerraportUserComponent::IsTeleporting() const
{
	return Phase != EPhase::Idle;
}

ATerraportScene* UTerraportUserComponent::FindScene()
{
	if (!IsValid(Scene) && GetWorld() != nullptr)
	{
		TActorIterator<ATerraportScene> First(GetWorld());
		Scene = First ? *First : nullptr;
	}
	return IsValid(Scene) ? Scene.Get() : nullptr;
}

void UTerraportUserComponent::TickComponent(float DeltaTime, ELevelTick TickType, FActorComponentTickFunction* ThisTickFunction)
{
	Super::TickComponent(DeltaTime, TickType, ThisTickFunction);
	PhaseS += double(DeltaTime);
	switch (Phase)
	{
	case EPhase::Darkening:
		if (PhaseS >= double(FadeS))
		{
			Enter(EPhase::Waiting);
		}
		break;
	case EPhase::Waiting:
		TickWaiting();
		break;
	case EPhase::Lightening:
		if (PhaseS >= double(FadeS))
		{
			Enter(EPhase::Idle);
		}
		break;
	case EPhase::Idle:
		break;
	}
}

void UTerraportUserComponent::TickWaiting()
{
	ATerraportScene* ActiveScene = FindScene();
	const FTerraportStatus Status = ActiveScene != nullptr ? ActiveScene->GetStatus() : FTerraportStatus();
	// Another component, or the game, may have landed since: that landing is not waited for.
	const bool bIsOurs = Status.Landing == Landing;
	if (ActiveScene == nullptr || (bIsOurs && Status.Phase == ETerraportLandingPhase::Refused))
	{
		GiveUp(Status);
	}
	else if (bIsOurs && (ActiveScene->Show() || Status.Phase == ETerraportLandingPhase::Shown))
	{
		Arrive();
	}
	else if (PhaseS >= double(MaxDarkS))
	{
		Arrive();
	}
}

void UTerraportUserComponent::EndPlay(const EEndPlayReason::Type EndPlayReason)
{
	if (IsTeleporting() && IsValid(Scene))
	{
		Scene->bAutoShow = bSceneAutoShow;
	}
	if (Phase == EPhase::Darkening || Phase == EPhase::Waiting)
	{
		// The camera's darkness is held by the player, who may go on without this pawn.
		Fade(1.0f, 0.0f, false);
	}
	Phase = EPhase::Idle;
	Super::EndPlay(EndPlayReason);
}

void UTerraportUserComponent::Enter(EPhase NewPhase)
{
	Phase = NewPhase;
	PhaseS = 0.0;
	if (NewPhase == EPhase::Darkening)
	{
		Fade(0.0f, 1.0f, true);
		OnDarken.Broadcast(FadeS);
	}
	else if (NewPhase == EPhase::Lightening)
	{
		if (IsValid(Scene))
		{
			Scene->bAutoShow = bSceneAutoShow;
		}
		Fade(1.0f, 0.0f, false);
		OnLighten.Broadcast(FadeS);
	}
}

void UTerraportUserComponent::Arrive()
{
	FTerraportGroundHit Ground;
	const FVector From = Target + FVector(0.0, 0.0, SearchAboveCm);
	const FVector Location = Scene->GroundAt(From, Ground) ? Ground.Location : Target;
	MoveOwner(Location);
	// Without detail the user stands on the base, and the scene shows what comes by its own setting, which Enter restores.
	Enter(EPhase::Lightening);
	OnTeleported.Broadcast(Location);
}

void UTerraportUserComponent::GiveUp(const FTerraportStatus& Status)
{
	FTerraportFailure Failure;
	Failure.Code = TEXT("refused");
	Failure.Message = Status.Refusal;
	Failure.Landing = Landing;
	Enter(EPhase::Lightening);
	OnTeleportFailed.Broadcast(Failure);
}

void UTerraportUserComponent::Fade(float From, float To, bool bHold)
{
	APlayerController* Player = bFadeCamera && GetWorld() != nullptr ? GetWorld()->GetFirstPlayerController() : nullptr;
	if (Player != nullptr && Player->PlayerCameraManager != nullptr)
	{
		Player->PlayerCameraManager->StartCameraFade(From, To, FadeS, FLinearColor::Black, false, bHold);
	}
}

void UTerraportUserComponent::MoveOwner(const FVector& Ground)
{
	AActor* Actor = GetOwner();
	if (Actor == nullptr)
	{
		return;
	}
	AController* Controller = Actor->GetInstigatorController();
	if (Controller != nullptr && Controller->GetPawn() == Actor)
	{
		// Where view or pawn follow the controller, the turn of the actor alone would be undone in the next frame.
		FRotator View = Controller->GetControlRotation();
		View.Yaw += double(TargetYaw);
		Controller->SetControlRotation(View);
	}
	Actor->AddActorWorldRotation(FRotator(0.0, double(TargetYaw), 0.0));
	// In a headset the head is somewhere in the room: it is the head that is to stand above the place, not the room's middle.
	FVector Offset = FVector::ZeroVector;
	if (const UCameraComponent* Camera = Actor->FindComponentByClass<UCameraComponent>())
	{
		Offset = Camera->GetComponentLocation() - Actor->GetActorLocation();
		Offset.Z = 0.0;
	}
	// A character's location is the middle of its capsule.
	const double HalfHeight = double(Actor->GetSimpleCollisionHalfHeight());
	Actor->SetActorLocation(Ground - Offset + FVector(0.0, 0.0, HalfHeight), false, nullptr, ETeleportType::TeleportPhysics);
}
