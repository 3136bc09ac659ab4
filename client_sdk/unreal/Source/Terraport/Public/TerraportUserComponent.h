#pragma once

#include "Components/ActorComponent.h"
#include "CoreMinimal.h"
#include "Engine/EngineTypes.h"
#include "TerraportTypes.h"

#include "TerraportUserComponent.generated.h"

class ATerraportScene;

DECLARE_DYNAMIC_MULTICAST_DELEGATE_OneParam(FTerraportFadeEvent, float, Seconds);
DECLARE_DYNAMIC_MULTICAST_DELEGATE_OneParam(FTerraportTeleportedEvent, const FVector&, Location);
DECLARE_DYNAMIC_MULTICAST_DELEGATE_OneParam(FTerraportTeleportFailedEvent, const FTerraportFailure&, Failure);

/**
 * Somebody who lands: put it on the pawn.
 *
 * TeleportTo does a whole teleport as comfort wants it: dark, wait until the ground is there, show it and move in one frame,
 * light. Land and Aim are the scene's, with this component's radius.
 */
UCLASS(ClassGroup = "Terraport", meta = (BlueprintSpawnableComponent, DisplayName = "Terraport User"))
class TERRAPORT_API UTerraportUserComponent : public UActorComponent
{
	GENERATED_BODY()

public:
	UTerraportUserComponent();

	/** The scene to land in. Empty: the first one of the level. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport")
	TObjectPtr<ATerraportScene> Scene;

	/** Metres of full detail around a landing. */
	UPROPERTY(
		EditAnywhere, BlueprintReadWrite, Category = "Terraport", meta = (ClampMin = "1", ClampMax = "10000", Units = "m"))
	double RadiusM = 60.0;

	/** What must be sharp first, metres, deadline and stall. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport")
	FTerraportLandOptions Options;

	/** Object types of your own things that stop an aim: walls, tables. The ground itself needs none. Empty: nothing does. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport")
	TArray<TEnumAsByte<EObjectTypeQuery>> Obstacles;

	/** Darken the camera by the player's camera manager. Needs post-processing: on mobile without Mobile HDR use OnDarken and
	 * OnLighten. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport|Teleport")
	bool bFadeCamera = true;

	/** Seconds to dark, and to light again. */
	UPROPERTY(
		EditAnywhere, BlueprintReadWrite, Category = "Terraport|Teleport", meta = (ClampMin = "0", ClampMax = "5", Units = "s"))
	float FadeS = 0.15f;

	/** Longest time in the dark, seconds. Then the user is moved all the same, onto the base, and detail follows when it is
	 * there. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport|Teleport",
		meta = (ClampMin = "0", ClampMax = "60", Units = "s"))
	float MaxDarkS = 6.0f;

	/** Begin to darken. For a fade of your own. */
	UPROPERTY(BlueprintAssignable, Category = "Terraport|Teleport")
	FTerraportFadeEvent OnDarken;

	/** Begin to lighten: the user was moved, or the landing was refused. For a fade of your own. */
	UPROPERTY(BlueprintAssignable, Category = "Terraport|Teleport")
	FTerraportFadeEvent OnLighten;

	/** The user was moved. Location: where the feet are, world space, centimetres. */
	UPROPERTY(BlueprintAssignable, Category = "Terraport|Teleport")
	FTerraportTeleportedEvent OnTeleported;

	/** The landing was refused; the user stays. */
	UPROPERTY(BlueprintAssignable, Category = "Terraport|Teleport")
	FTerraportTeleportFailedEvent OnTeleportFailed;

	/** See ATerraportScene::Land. -1 without a scene. */
	UFUNCTION(BlueprintCallable, Category = "Terraport")
	int64 Land(const FVector& WorldLocation);

	/** See ATerraportScene::Aim. */
	UFUNCTION(BlueprintCallable, Category = "Terraport")
	void Aim(const FVector& WorldLocation);

	/** Aim along a ray of MaxDistanceCm. True, and where, if it meets ground before an obstacle; the scene then loads ahead.
	 * Call it in every frame. */
	UFUNCTION(BlueprintCallable, Category = "Terraport")
	bool TryAim(const FVector& WorldStart, const FVector& WorldDirection, double MaxDistanceCm, FTerraportGroundHit& Hit);

	/** Whether an obstacle lies between two locations: for an arc, piece by piece. */
	UFUNCTION(BlueprintCallable, BlueprintPure = false, Category = "Terraport")
	bool IsObstructed(const FVector& WorldStart, const FVector& WorldEnd) const;

	/** Teleport: feet on the ground at this location, the head above it, looking the same way, turned by YawDegrees. One that
	 * is under way is replaced. False without an open scene. */
	UFUNCTION(BlueprintCallable, Category = "Terraport|Teleport")
	bool TeleportTo(const FVector& WorldLocation, float YawDegrees = 0.0f);

	/** Teleport to a named region: to where it is seen best, looking at it, with the radius that shows it. False where there is
	 * no such name. */
	UFUNCTION(BlueprintCallable, Category = "Terraport|Teleport")
	bool TeleportToPlace(const FString& Name);

	UFUNCTION(BlueprintPure, Category = "Terraport|Teleport")
	bool IsTeleporting() const;

	/** Scene, or where that is empty or destroyed the first one of the level, from then on Scene. Null without one. */
	UFUNCTION(BlueprintCallable, Category = "Terraport")
	ATerraportScene* FindScene();

	virtual void TickComponent(float DeltaTime, ELevelTick TickType, FActorComponentTickFunction* ThisTickFunction) override;
	virtual void EndPlay(const EEndPlayReason::Type EndPlayReason) override;

private:
	enum class EPhase : uint8
	{
		Idle,
		Darkening,
		/** Dark, until the landing can be shown, is refused, or MaxDarkS have passed. */
		Waiting,
		Lightening,
	};

	bool Teleport(const FVector& WorldLocation, float YawDegrees, double LandingRadiusM);
	void Enter(EPhase NewPhase);
	/** Ends the dark when the landing is shown or refused, or after MaxDarkS. */
	void TickWaiting();
	void Arrive();
	void GiveUp(const FTerraportStatus& Status);
	void Fade(float From, float To, bool bHold);
	void MoveOwner(const FVector& Ground);

	EPhase Phase = EPhase::Idle;
	double PhaseS = 0.0;
	FVector Target = FVector::ZeroVector;
	float TargetYaw = 0.0f;
	int64 Landing = 0;
	bool bSceneAutoShow = true;
};
