#include "TerraportTeleportPawn.h"

#include "Camera/CameraComponent.h"
#include "Components/InputComponent.h"
#include "Components/SceneComponent.h"
#include "Components/StaticMeshComponent.h"
#include "Engine/StaticMesh.h"
#include "GameFramework/Controller.h"
#include "InputCoreTypes.h"
#include "MotionControllerComponent.h"
#include "TerraportScene.h"
#include "TerraportUserComponent.h"
#include "UObject/ConstructorHelpers.h"

#include <cmath>

namespace
{
/** Pieces of the arc: straight, so the shorter the nearer to a parabola. */
constexpr double ArcStepS = 1.0 / 30.0;
constexpr int32 ArcSteps = 120;
constexpr double GravityCmS2 = 981.0;
constexpr double EyeHeightCm = 170.0;
constexpr float TurnDegrees = 30.0f;
constexpr double DegreesPerRadian = 57.295779513082321;
} // namespace

ATerraportTeleportPawn::ATerraportTeleportPawn()
{
	PrimaryActorTick.bCanEverTick = true;
	SetRootComponent(CreateDefaultSubobject<USceneComponent>(TEXT("Root")));
	Camera = CreateDefaultSubobject<UCameraComponent>(TEXT("Camera"));
	Camera->SetupAttachment(GetRootComponent());
	// A headset's pose takes the place of this.
	Camera->SetRelativeLocation(FVector(0.0, 0.0, EyeHeightCm));
	Camera->bUsePawnControlRotation = true;
	LeftHand = CreateDefaultSubobject<UMotionControllerComponent>(TEXT("LeftHand"));
	LeftHand->SetupAttachment(GetRootComponent());
	LeftHand->SetTrackingMotionSource(TEXT("Left"));
	RightHand = CreateDefaultSubobject<UMotionControllerComponent>(TEXT("RightHand"));
	RightHand->SetupAttachment(GetRootComponent());
	RightHand->SetTrackingMotionSource(TEXT("Right"));
	Marker = CreateDefaultSubobject<UStaticMeshComponent>(TEXT("Marker"));
	Marker->SetupAttachment(GetRootComponent());
	Marker->SetCollisionEnabled(ECollisionEnabled::NoCollision);
	Marker->SetCastShadow(false);
	Marker->SetVisibility(false);
	Marker->SetWorldScale3D(FVector(0.8, 0.8, 0.02));
	static ConstructorHelpers::FObjectFinder<UStaticMesh> Cylinder(TEXT("/Engine/BasicShapes/Cylinder.Cylinder"));
	Marker->SetStaticMesh(Cylinder.Object);
	User = CreateDefaultSubobject<UTerraportUserComponent>(TEXT("User"));
}

void ATerraportTeleportPawn::BeginAim(bool bRightHand)
{
	bByRightHand = bRightHand;
	bAiming = true;
}

void ATerraportTeleportPawn::EndAim()
{
	if (bAiming && bHasTarget)
	{
		User->TeleportTo(AimedAt);
	}
	CancelAim();
}

void ATerraportTeleportPawn::CancelAim()
{
	bAiming = false;
	bHasTarget = false;
	Marker->SetVisibility(false);
}

void ATerraportTeleportPawn::Turn(float Degrees)
{
	if (Controller != nullptr)
	{
		// At the desk the camera follows the controller, which does not follow the actor.
		FRotator View = Controller->GetControlRotation();
		View.Yaw += double(Degrees);
		Controller->SetControlRotation(View);
	}
	const FVector Before = Camera->GetComponentLocation();
	AddActorWorldRotation(FRotator(0.0, double(Degrees), 0.0));
	// Without this the room would turn about its own middle, and the head be carried sideways.
	AddActorWorldOffset(Before - Camera->GetComponentLocation());
}

void ATerraportTeleportPawn::Tick(float DeltaSeconds)
{
	Super::Tick(DeltaSeconds);
	if (!bAiming)
	{
		return;
	}
	bHasTarget = FindTarget(AimedAt);
	Marker->SetVisibility(bHasTarget);
	if (bHasTarget)
	{
		Marker->SetWorldLocation(AimedAt);
		// Detail begins to come before the button is let go.
		User->Aim(AimedAt);
	}
}

void ATerraportTeleportPawn::SetupPlayerInputComponent(UInputComponent* PlayerInputComponent)
{
	Super::SetupPlayerInputComponent(PlayerInputComponent);
	PlayerInputComponent->BindKey(EKeys::LeftMouseButton, IE_Pressed, this, &ATerraportTeleportPawn::AimByMouse);
	PlayerInputComponent->BindKey(EKeys::LeftMouseButton, IE_Released, this, &ATerraportTeleportPawn::EndAim);
	PlayerInputComponent->BindKey(EKeys::RightMouseButton, IE_Pressed, this, &ATerraportTeleportPawn::CancelAim);
	PlayerInputComponent->BindKey(EKeys::Q, IE_Pressed, this, &ATerraportTeleportPawn::TurnLeft);
	PlayerInputComponent->BindKey(EKeys::E, IE_Pressed, this, &ATerraportTeleportPawn::TurnRight);
	PlayerInputComponent->BindAxisKey(EKeys::MouseX, this, &ATerraportTeleportPawn::AddControllerYawInput);
	PlayerInputComponent->BindAxisKey(EKeys::MouseY, this, &ATerraportTeleportPawn::AddControllerPitchInput);
}

bool ATerraportTeleportPawn::FindTarget(FVector& Target) const
{
	const ATerraportScene* Scene = User->FindScene();
	if (Scene == nullptr)
	{
		return false;
	}
	const UMotionControllerComponent* Hand = bByRightHand ? RightHand : LeftHand;
	const USceneComponent* From = Camera;
	if (Hand->IsTracked())
	{
		From = Hand;
	}
	FVector Point = From->GetComponentLocation();
	FVector Velocity = From->GetForwardVector() * ArcSpeedCmS;
	for (int32 Step = 0; Step < ArcSteps; ++Step)
	{
		const FVector Displacement = Velocity * ArcStepS;
		FTerraportGroundHit Hit;
		const bool bMet = Scene->CastGround(Point, Displacement, Displacement.Size(), Hit);
		if (User->IsObstructed(Point, bMet ? Hit.Location : Point + Displacement))
		{
			return false;
		}
		if (bMet)
		{
			Target = Hit.Location;
			const double SlopeDeg = std::acos(FMath::Clamp(Hit.Normal.Z, -1.0, 1.0)) * DegreesPerRadian;
			return SlopeDeg <= MaxSlopeDeg;
		}
		Point += Displacement;
		Velocity.Z -= GravityCmS2 * ArcStepS;
	}
	return false;
}

void ATerraportTeleportPawn::AimByMouse()
{
	BeginAim(true);
}

void ATerraportTeleportPawn::TurnLeft()
{
	Turn(-TurnDegrees);
}

void ATerraportTeleportPawn::TurnRight()
{
	Turn(TurnDegrees);
}
