#pragma once

#include "CoreMinimal.h"
#include "GameFramework/Pawn.h"

#include "TerraportTeleportPawn.generated.h"

class UCameraComponent;
class UMotionControllerComponent;
class USceneComponent;
class UStaticMeshComponent;
class UTerraportUserComponent;

/**
 * A pawn that teleports: aim along an arc, let go, land.
 *
 * Works with mouse and keyboard as it is (left button: aim and land; right button: cancel; Q and E: turn). In a headset bind
 * BeginAim, EndAim, CancelAim and Turn to Enhanced Input actions in a Blueprint of this class: OpenXR only offers what input
 * mappings ask for, and those are assets (docs/how-to/unreal.md).
 */
UCLASS(BlueprintType, Blueprintable, meta = (DisplayName = "Terraport Teleport Pawn"))
class TERRAPORTSAMPLE_API ATerraportTeleportPawn : public APawn
{
	GENERATED_BODY()

public:
	ATerraportTeleportPawn();

	UPROPERTY(VisibleAnywhere, BlueprintReadOnly, Category = "Terraport")
	TObjectPtr<UCameraComponent> Camera;

	UPROPERTY(VisibleAnywhere, BlueprintReadOnly, Category = "Terraport")
	TObjectPtr<UMotionControllerComponent> LeftHand;

	UPROPERTY(VisibleAnywhere, BlueprintReadOnly, Category = "Terraport")
	TObjectPtr<UMotionControllerComponent> RightHand;

	/** Lies where the arc ends. */
	UPROPERTY(VisibleAnywhere, BlueprintReadOnly, Category = "Terraport")
	TObjectPtr<UStaticMeshComponent> Marker;

	UPROPERTY(VisibleAnywhere, BlueprintReadOnly, Category = "Terraport")
	TObjectPtr<UTerraportUserComponent> User;

	/** How fast the arc starts, centimetres a second: faster reaches farther. */
	UPROPERTY(
		EditAnywhere, BlueprintReadWrite, Category = "Terraport", meta = (ClampMin = "200", ClampMax = "20000", Units = "cm/s"))
	double ArcSpeedCmS = 1400.0;

	/** Steepest ground that can be stood on, degrees. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport", meta = (ClampMin = "0", ClampMax = "90", Units = "deg"))
	double MaxSlopeDeg = 45.0;

	/** Begin to aim, with the right hand or the left one; without tracked hands along the line of sight. */
	UFUNCTION(BlueprintCallable, Category = "Terraport")
	void BeginAim(bool bRightHand = true);

	/** Land where the arc ends; nothing happens where it ends in the air, or on ground that is too steep. */
	UFUNCTION(BlueprintCallable, Category = "Terraport")
	void EndAim();

	UFUNCTION(BlueprintCallable, Category = "Terraport")
	void CancelAim();

	/** Turn on the spot, about the head; degrees, clockwise from above. */
	UFUNCTION(BlueprintCallable, Category = "Terraport")
	void Turn(float Degrees);

	virtual void Tick(float DeltaSeconds) override;
	virtual void SetupPlayerInputComponent(UInputComponent* PlayerInputComponent) override;

private:
	/** Where the arc meets ground that can be stood on. */
	bool FindTarget(FVector& Target) const;
	void AimByMouse();
	void TurnLeft();
	void TurnRight();

	bool bAiming = false;
	bool bByRightHand = true;
	bool bHasTarget = false;
	FVector AimedAt = FVector::ZeroVector;
};
