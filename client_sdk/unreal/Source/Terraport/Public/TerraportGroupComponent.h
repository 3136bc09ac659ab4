#pragma once

#include "Components/ActorComponent.h"
#include "CoreMinimal.h"
#include "TerraportTypes.h"

#include "TerraportGroupComponent.generated.h"

class ATerraportScene;
class FTerraportSession;
class UTerraportUserComponent;
struct FTerraportGroupNews;

/** Somebody in a group. */
USTRUCT(BlueprintType)
struct TERRAPORT_API FTerraportGroupMember
{
	GENERATED_BODY()

	/** Number in the group, never given again in it. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport|Group")
	int64 Member = 0;

	/** What they call themselves: text of theirs, to be shown as text. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport|Group")
	FString Name;

	/** The guide lands the group; there is one at most. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport|Group")
	bool bGuide = false;

	/** False where the connection is lost and the seat is kept. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport|Group")
	bool bPresent = false;

	/** False before they landed for the first time. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport|Group")
	bool bHasLanded = false;

	/** Where they landed last, world space. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport|Group")
	FVector Location = FVector::ZeroVector;
};

/** The group that this client has a seat in. */
USTRUCT(BlueprintType)
struct TERRAPORT_API FTerraportGroup
{
	GENERATED_BODY()

	/** Empty without a seat; nothing below counts then. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport|Group")
	FString Name;

	/** Own number in the group. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport|Group")
	int64 Member = 0;

	UPROPERTY(BlueprintReadOnly, Category = "Terraport|Group")
	bool bGuide = false;

	UPROPERTY(BlueprintReadOnly, Category = "Terraport|Group")
	TArray<FTerraportGroupMember> Members;

	/** Number of the newest landing of the group; 0 before the first. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport|Group")
	int64 Gathering = 0;

	/** Where that is, world space. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport|Group")
	FVector Location = FVector::ZeroVector;

	UPROPERTY(BlueprintReadOnly, Category = "Terraport|Group")
	double RadiusM = 0.0;

	/** Everybody is there, or nobody waits any longer. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport|Group")
	bool bOver = false;

	/** Members who were there then, whole or with the inner part alone, and who were not. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport|Group")
	TArray<int64> Ready;

	UPROPERTY(BlueprintReadOnly, Category = "Terraport|Group")
	TArray<int64> Degraded;

	UPROPERTY(BlueprintReadOnly, Category = "Terraport|Group")
	TArray<int64> Missing;
};

DECLARE_DYNAMIC_MULTICAST_DELEGATE_OneParam(FTerraportGroupEvent, const FTerraportGroup&, Group);
DECLARE_DYNAMIC_MULTICAST_DELEGATE_OneParam(FTerraportGroupRefusedEvent, const FString&, Message);

/**
 * The user's part in a group that visits a scene together: joins by name, lands where the guide lands everybody, lands
 * everybody as the guide. Put it on the pawn, or on the scene's actor.
 */
UCLASS(ClassGroup = "Terraport", meta = (BlueprintSpawnableComponent, DisplayName = "Terraport Group"))
class TERRAPORT_API UTerraportGroupComponent : public UActorComponent
{
	GENERATED_BODY()

public:
	UTerraportGroupComponent();

	/** The scene to visit together. Empty: the first one of the level. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport|Group")
	TObjectPtr<ATerraportScene> Scene;

	/** Takes the user along in the dark of a fade. Empty: what is shown changes, and the user stays. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport|Group")
	TObjectPtr<UTerraportUserComponent> User;

	/** Land where the guide does. Else the group is told that this one does not come; GoThere may still be called. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport|Group")
	bool bFollow = true;

	/** Who is in the group, or where it goes, has changed. */
	UPROPERTY(BlueprintAssignable, Category = "Terraport|Group")
	FTerraportGroupEvent OnChanged;

	/** The guide lands the group. */
	UPROPERTY(BlueprintAssignable, Category = "Terraport|Group")
	FTerraportGroupEvent OnCalled;

	/** Everybody is there, or nobody waits any longer. */
	UPROPERTY(BlueprintAssignable, Category = "Terraport|Group")
	FTerraportGroupEvent OnGathered;

	/** A join or gather was refused. */
	UPROPERTY(BlueprintAssignable, Category = "Terraport|Group")
	FTerraportGroupRefusedEvent OnRefused;

	/** Take a seat (Name: 1 to 64 of A-Z a-z 0-9 _ . ~ -); one held before is left. False before the scene is open, and where a
	 * name cannot be. */
	UFUNCTION(BlueprintCallable, Category = "Terraport|Group")
	bool Join(const FString& Name, bool bAsGuide, const FString& OwnName);

	/** Give the seat up. */
	UFUNCTION(BlueprintCallable, Category = "Terraport|Group")
	void Leave();

	/** Land everybody there, as the guide. False without a seat, and where a number cannot be. */
	UFUNCTION(BlueprintCallable, Category = "Terraport|Group")
	bool Gather(const FVector& WorldLocation, double RadiusM);

	/** Go where the group is, though that was not followed. False where it is nowhere. */
	UFUNCTION(BlueprintCallable, Category = "Terraport|Group")
	bool GoThere();

	/** The group as it is now. */
	UFUNCTION(BlueprintPure, Category = "Terraport|Group")
	FTerraportGroup GetGroup() const;

	virtual void TickComponent(float DeltaTime, ELevelTick TickType, FActorComponentTickFunction* ThisTickFunction) override;
	virtual void EndPlay(const EEndPlayReason::Type EndPlayReason) override;

private:
	/** Null before the scene is open. */
	FTerraportSession* FindSession();
	/** An event of the core. */
	void Take(const FTerraportGroupNews& News);
	void TellArrival();
	void Forget();

	FTerraportGroup Group;
	/** Of the newest gathering. */
	FTerraportLandOptions Options;
	/** The landing that the group waits for; 0 for none. */
	int64 AwaitedLanding = 0;
	bool bToldDegraded = false;
};
