#pragma once

#include "CoreMinimal.h"
#include "GameFramework/Actor.h"
#include "TerraportSettings.h"
#include "TerraportTypes.h"

#include "TerraportScene.generated.h"

class FTerraportSession;
class UMaterialInterface;
class USceneComponent;

DECLARE_DYNAMIC_MULTICAST_DELEGATE(FTerraportOpenedEvent);
DECLARE_DYNAMIC_MULTICAST_DELEGATE_OneParam(FTerraportLinkEvent, const FTerraportLink&, Link);
DECLARE_DYNAMIC_MULTICAST_DELEGATE_OneParam(FTerraportPlanEvent, const FTerraportPlan&, Plan);
DECLARE_DYNAMIC_MULTICAST_DELEGATE_OneParam(FTerraportReadyEvent, const FTerraportReady&, Ready);
DECLARE_DYNAMIC_MULTICAST_DELEGATE_OneParam(FTerraportLandingEvent, int64, Landing);
DECLARE_DYNAMIC_MULTICAST_DELEGATE_OneParam(FTerraportShownEvent, const FTerraportSwap&, Swap);
DECLARE_DYNAMIC_MULTICAST_DELEGATE_OneParam(FTerraportFailedEvent, const FTerraportFailure&, Failure);
DECLARE_DYNAMIC_MULTICAST_DELEGATE_OneParam(FTerraportPickedEvent, const FTerraportPick&, Pick);

/**
 * A surveyed place, streamed: the base mesh of everything, and full detail around the last landing.
 *
 * Put one into the level, give it the address of a scene and a token, and call Land. What is shown changes in the frame of a
 * swap alone, never with the head. The scene's origin is the actor's; metres become centimetres; X is east, Y south, Z up. Move
 * and turn the actor as you like before it opens; scale must be 1.
 *
 * Every function is called, and every event raised, on the game thread.
 */
UCLASS(BlueprintType, meta = (DisplayName = "Terraport Scene"))
class TERRAPORT_API ATerraportScene : public AActor
{
	GENERATED_BODY()

public:
	ATerraportScene();
	virtual ~ATerraportScene() override;

	/** Address of a scene (https://host/scenes/quarry), or of a server that has one scene alone. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport")
	FString SceneUrl = TEXT("http://127.0.0.1:8080");

	/** Bearer token, where the server wants one. Saved in the level in the clear: for anything but a trial set it at run time.
	 */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport", meta = (PasswordField = "true"))
	FString Token;

	/** Open when play begins. Otherwise call Open. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport")
	bool bOpenOnBeginPlay = true;

	/** Show a landing as soon as all of it can be drawn; may be changed at any time. Switch it off to show it in the dark of a
	 * fade, by Show; a TerraportUserComponent that teleports does so. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport")
	bool bAutoShow = true;

	/** Around full detail show a ring of the coarser level, to three times the radius, where the scene has one; may be changed
	 * at any time, for the landings from then on. Budgets count both; where there is no room for both the ring gives way. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport")
	bool bShowsCoarse = true;

	/** What this device is asked to hold. Counts when the scene is opened. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport|Budgets")
	ETerraportDevice Device = ETerraportDevice::Desktop;

	/** With Device Custom. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport|Budgets",
		meta = (EditCondition = "Device == ETerraportDevice::Custom"))
	FTerraportBudgets CustomBudgets;

	/** Milliseconds of each frame that the game thread may spend here. Less makes landings slower, more makes frames longer; 1
	 * for a headset at 90 Hz. The step in hand is ended: about half a millisecond more. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport|Performance",
		meta = (ClampMin = "0.1", ClampMax = "30", Units = "ms"))
	float FrameBudgetMs = 2.0f;

	/** Payloads decoded at a time on task threads. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport|Performance", meta = (ClampMin = "1", ClampMax = "16"))
	int32 DecodeTasks = 2;

	/** Make what is shown solid around this actor (a walking pawn), within FeetReachCm and up to MaxFeetFaces, cooked on the
	 * engine's threads as it walks. Empty: nobody walks. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport|Performance")
	TObjectPtr<AActor> FeetOf;

	/** Half the side of the cube that is solid around FeetOf. More: cooked less often, and longer. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport|Performance",
		meta = (ClampMin = "100", ClampMax = "5000", Units = "cm"))
	float FeetReachCm = 400.0f;

	/** Faces that are solid around FeetOf at most; where there are more the cube is halved. */
	UPROPERTY(
		EditAnywhere, BlueprintReadWrite, Category = "Terraport|Performance", meta = (ClampMin = "256", ClampMax = "65536"))
	int32 MaxFeetFaces = 8192;

	/** Surveys have their light in their colours, and shadows are dear. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport|Performance")
	bool bCastShadows = false;

	/** Show the base in the editor's viewport, and a landing below its camera. Nothing of it is saved with the level. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport|Preview")
	bool bPreviewInEditor = false;

	/** Radius of the preview's landings. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport|Preview",
		meta = (ClampMin = "1", ClampMax = "10000", Units = "m"))
	double PreviewRadiusM = 40.0;

	/** Take the project's lights and cast shadows: by the lit ones of the materials that terraport_materials.py makes, where
	 * none is chosen below. Off: the survey's own light, which costs least. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport|Materials")
	bool bLit = false;

	/** Draws detail without textures, by its Vertex Color. Two-sided. Empty: M_TerraportColour of /Game/Terraport; where that
	 * was not made, the engine's debug material, for a first look. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport|Materials")
	TObjectPtr<UMaterialInterface> ColourMaterial;

	/** Draws textured detail; its texture parameter is TextureParameter. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport|Materials")
	TObjectPtr<UMaterialInterface> TextureMaterial;

	/** Draws the base without texture. Must push it back along the line of sight by PushParameter centimetres (World Position
	 * Offset), or the base pokes through detail at the rim. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport|Materials")
	TObjectPtr<UMaterialInterface> BaseColourMaterial;

	/** Draws a textured base; as both of the above. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport|Materials")
	TObjectPtr<UMaterialInterface> BaseTextureMaterial;

	/** Texture parameter of the two texture materials. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport|Materials")
	FName TextureParameter = TEXT("TerraportTexture");

	/** Scalar parameter of the two base materials, centimetres. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport|Materials")
	FName PushParameter = TEXT("TerraportPushBackCm");

	/** How vertex colours are coded. The materials of terraport_materials.py want sRGB; the fallback material always gets
	 * linear. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport|Materials")
	ETerraportVertexColours VertexColours = ETerraportVertexColours::Srgb;

	/** Base mesh and connection are there: Land is answered from now on. Told again after a new version was published. */
	UPROPERTY(BlueprintAssignable, Category = "Terraport")
	FTerraportOpenedEvent OnOpened;

	/** The connection changed. Reconnecting is automatic, and nothing is loaded twice. */
	UPROPERTY(BlueprintAssignable, Category = "Terraport")
	FTerraportLinkEvent OnLink;

	/** The server answered a landing with what it will send. */
	UPROPERTY(BlueprintAssignable, Category = "Terraport")
	FTerraportPlanEvent OnPlan;

	/** Every byte of a landing is here. It is shown some frames later: see OnShown. */
	UPROPERTY(BlueprintAssignable, Category = "Terraport")
	FTerraportReadyEvent OnReady;

	/** The deadline of a landing passed: its inner part is shown first, the rest goes on coming. */
	UPROPERTY(BlueprintAssignable, Category = "Terraport")
	FTerraportLandingEvent OnDegraded;

	/** With bAutoShow off: the landing (or its inner part) can be shown, by Show. */
	UPROPERTY(BlueprintAssignable, Category = "Terraport")
	FTerraportLandingEvent OnPresentable;

	/** What is shown changed in this frame. */
	UPROPERTY(BlueprintAssignable, Category = "Terraport")
	FTerraportShownEvent OnShown;

	/** Something did not work; what is shown stays. */
	UPROPERTY(BlueprintAssignable, Category = "Terraport")
	FTerraportFailedEvent OnFailed;

	/** Answer to Pick. */
	UPROPERTY(BlueprintAssignable, Category = "Terraport")
	FTerraportPickedEvent OnPicked;

	/** Load the base and connect, with the properties as they are now. Closes what was open before. */
	UFUNCTION(BlueprintCallable, Category = "Terraport")
	void Open();

	/** Say goodbye, and free everything that is drawn. */
	UFUNCTION(BlueprintCallable, Category = "Terraport")
	void Close();

	/** Ask this for the token before each connection and each loading, in place of Token: a session then outlives its tokens.
	 * It answers at once with what it has, and calls nothing of the scene; ask your server for the next token before the
	 * present one ends. Counts when the scene is opened. An unbound delegate, or one whose object is gone, leaves it to Token.
	 */
	UFUNCTION(BlueprintCallable, Category = "Terraport")
	void SetTokenProvider(FTerraportTokenProvider Provider);

	/** Connect now: after the link was closed for good, or to cut a wait short. A token that is not empty replaces the present
	 * one, and the token provider. */
	UFUNCTION(BlueprintCallable, Category = "Terraport")
	void Reconnect(const FString& NewToken);

	/** Ask for full detail around a location. A newer landing supersedes one that is not ready. Returns its number in the
	 * events; 0 where the scene is not open yet (the newest such landing is asked for as soon as it is), -1 where the numbers
	 * are no location. */
	UFUNCTION(BlueprintCallable, Category = "Terraport", meta = (AdvancedDisplay = "Options", AutoCreateRefTerm = "Options"))
	int64 Land(const FVector& WorldLocation, double RadiusM, const FTerraportLandOptions& Options);

	/** Tell where the user points: detail starts to come, at low priority, and a landing there is quicker. Call it as often as
	 * you like; only the newest counts, ten times a second at most. */
	UFUNCTION(BlueprintCallable, Category = "Terraport")
	void Aim(const FVector& WorldLocation, double RadiusM);

	/** Ask the server what full detail has along a ray, loaded or not; answered by OnPicked. Returns the request's number, -1
	 * where it cannot be asked. */
	UFUNCTION(BlueprintCallable, Category = "Terraport")
	int64 Pick(const FVector& WorldOrigin, const FVector& WorldDirection);

	/** Show the newest landing now, in this frame. False where nothing new can be shown. */
	UFUNCTION(BlueprintCallable, Category = "Terraport")
	bool Show();

	/** First point of what is shown along a ray of MaxDistanceCm. Exact, without collision; a fraction of a millisecond. */
	UFUNCTION(BlueprintCallable, BlueprintPure = false, Category = "Terraport")
	bool CastGround(
		const FVector& WorldStart, const FVector& WorldDirection, double MaxDistanceCm, FTerraportGroundHit& Hit) const;

	/** Ground of what is shown on the vertical through a location: the highest not above it, else the lowest above it. */
	UFUNCTION(BlueprintCallable, BlueprintPure = false, Category = "Terraport")
	bool GroundAt(const FVector& WorldLocation, FTerraportGroundHit& Hit) const;

	/** The named regions as places to go to, by name, the largest of each name first; empty before the scene is open. */
	UFUNCTION(BlueprintCallable, BlueprintPure = false, Category = "Terraport")
	TArray<FTerraportPlace> GetPlaces() const;

	/** The place of that name, whatever its case; of several the largest. False where there is none. */
	UFUNCTION(BlueprintCallable, BlueprintPure = false, Category = "Terraport")
	bool FindPlace(const FString& Name, FTerraportPlace& Place) const;

	/** Coarser pieces that a region is part of, finest first: what a pick's Region lies in. Empty where the scene says nothing
	 * of it. */
	UFUNCTION(BlueprintCallable, BlueprintPure = false, Category = "Terraport")
	TArray<FTerraportCoarserPiece> GetCoarserPieces(int32 Region) const;

	/** Whether base and connection were there once, since Open. */
	UFUNCTION(BlueprintPure, Category = "Terraport")
	bool IsOpen() const;

	UFUNCTION(BlueprintPure, Category = "Terraport")
	FTerraportStatus GetStatus() const;

	UFUNCTION(BlueprintCallable, Category = "Terraport")
	FTerraportStats TakeStats();

	/** Box of the scene, world space; empty before it is open. */
	UFUNCTION(BlueprintPure, Category = "Terraport")
	FBox GetSceneBounds() const;

	/** East, north and height in the survey's reference system, metres, of a location in the world. False before the scene is
	 * open. */
	UFUNCTION(BlueprintCallable, BlueprintPure = false, Category = "Terraport")
	bool WorldToSurvey(const FVector& WorldLocation, FVector& EastNorthHeightM) const;

	/** The inverse of WorldToSurvey. */
	UFUNCTION(BlueprintCallable, BlueprintPure = false, Category = "Terraport")
	bool SurveyToWorld(const FVector& EastNorthHeightM, FVector& WorldLocation) const;

	/** For the plugin's own components; null while it is closed. */
	FTerraportSession* GetSession() const { return Session.Get(); }

	virtual void Tick(float DeltaSeconds) override;
	virtual void BeginPlay() override;
	virtual void EndPlay(const EEndPlayReason::Type EndPlayReason) override;
	virtual void BeginDestroy() override;
	/** Also without play, where the editor's viewport shows a preview. */
	virtual bool ShouldTickIfViewportsOnly() const override;
	/** Also where it is deleted in the editor. */
	virtual void Destroyed() override;
#if WITH_EDITOR
	virtual void PostEditChangeProperty(FPropertyChangedEvent& Event) override;
#endif

private:
	void TickSession();
	/** Of the editor's world: open, and land where the viewport's camera has come to. */
	void TickPreview();

	UPROPERTY()
	TObjectPtr<USceneComponent> Root;

	/** The materials that the editor made in the project: a packaged game has only what something refers to. */
	UPROPERTY()
	TArray<TObjectPtr<UMaterialInterface>> MadeMaterials;

	UPROPERTY(Transient)
	FTerraportTokenProvider TokenProvider;

	/** What plain C++ points to, for the garbage collector. */
	UPROPERTY(Transient, DuplicateTransient)
	TSet<TObjectPtr<UObject>> ReferencedObjects;

	/** Shared with Tick alone, so that a listener may close the scene from within an event. */
	TSharedPtr<FTerraportSession> Session;

	/** Where the preview has landed last. */
	TOptional<FVector> PreviewedAt;

	/** A landing that was asked for before Open. */
	bool bLandAtOpen = false;
	FVector OpenLocation = FVector::ZeroVector;
	double OpenRadiusM = 0.0;
	FTerraportLandOptions OpenOptions;
};
