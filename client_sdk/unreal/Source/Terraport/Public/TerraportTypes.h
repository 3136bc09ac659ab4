#pragma once

#include "CoreMinimal.h"

#include "TerraportTypes.generated.h"

/** Gives the present token, at once. */
DECLARE_DYNAMIC_DELEGATE_RetVal(FString, FTerraportTokenProvider);

/** Where the connection stands. */
UENUM(BlueprintType)
enum class ETerraportLink : uint8
{
	Connecting,
	Open,
	/** Lost; the next attempt follows by itself. */
	Waiting,
	/** For good, until Reconnect is called. */
	Closed,
};

/** Where the newest landing stands. */
UENUM(BlueprintType)
enum class ETerraportLandingPhase : uint8
{
	/** There was none. */
	None,
	/** Asked for; no plan yet. */
	Planning,
	/** Detail comes and is made drawable. */
	Loading,
	/** Show would show the inner part, the deadline being over. */
	PresentableDegraded,
	/** Show would show all of it. */
	Presentable,
	/** The inner part is what is drawn. */
	ShownDegraded,
	/** It is what is drawn. */
	Shown,
	/** The server said no; what was shown stays. */
	Refused,
};

/** Options of a landing, besides its position and radius. */
USTRUCT(BlueprintType)
struct TERRAPORT_API FTerraportLandOptions
{
	GENERATED_BODY()

	/** Beyond the radius everything up to here comes at its coarser level, where the scene has one, metres; 0 leaves it to the
	 * scene's bShowsCoarse. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport", meta = (ClampMin = "0", Units = "m"))
	double CoarseRadiusM = 0.0;

	/** Radius in metres of what must be sharp first; 0 for none. It is shown alone where the deadline passes before the rest is
	 * here. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport", meta = (ClampMin = "0", Units = "m"))
	double InnerRadiusM = 0.0;

	/** Milliseconds after which the inner part is shown alone; 0 for never. Needs an inner radius. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport", meta = (ClampMin = "0", Units = "ms"))
	int32 DeadlineMs = 0;

	/** Milliseconds without progress after which the same happens; 0 for never. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport", meta = (ClampMin = "0", Units = "ms"))
	int32 StallMs = 0;
};

/** What a landing will bring. */
USTRUCT(BlueprintType)
struct TERRAPORT_API FTerraportPlan
{
	GENERATED_BODY()

	/** Number that Land returned. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int64 Landing = 0;

	/** Radius asked for, metres. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	double RadiusM = 0.0;

	/** Smaller where a budget cut the plan, metres. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	double EffectiveRadiusM = 0.0;

	/** How far the coarser level reaches beyond it, metres; 0 where there is none of it. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	double CoarseRadiusM = 0.0;

	/** Segments that are on their way. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int32 LoadSegments = 0;

	/** Segments that were here already. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int32 KeptSegments = 0;

	/** Bytes on their way. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int64 LoadBytes = 0;

	/** Triangles of the whole landing. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int64 Triangles = 0;

	/** Segments left out by a budget. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int32 OmittedSegments = 0;
};

/** A landing whose bytes are all here. */
USTRUCT(BlueprintType)
struct TERRAPORT_API FTerraportReady
{
	GENERATED_BODY()

	/** Number that Land returned. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int64 Landing = 0;

	/** Segments that are shown. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int32 Segments = 0;

	/** Segments that the server could not deliver: their ground stays base. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int32 Missing = 0;

	/** Milliseconds from Land until every byte was here. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	double ElapsedMs = 0.0;

	/** Bytes that came for it. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int64 PayloadBytes = 0;
};

/** Something did not work. What is shown stays. */
USTRUCT(BlueprintType)
struct TERRAPORT_API FTerraportFailure
{
	GENERATED_BODY()

	/** For programs: an error code of the wire protocol, or of the client ("damaged", "unreachable", "invalid_url" ...). */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	FString Code;

	/** For people: what was met, what was expected. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	FString Message;

	/** The landing that it ended, or 0. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int64 Landing = 0;

	/** Nothing goes on until Open or Reconnect is called. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	bool bFatal = false;
};

/** News of the connection. */
USTRUCT(BlueprintType)
struct TERRAPORT_API FTerraportLink
{
	GENERATED_BODY()

	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	ETerraportLink State = ETerraportLink::Closed;

	/** Number of the attempt, from 1. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int32 Attempt = 0;

	/** Seconds until the next attempt. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	double RetryInS = 0.0;

	/** WebSocket close code of the connection before. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int32 CloseCode = 0;

	/** Why, for programs; empty where all is well. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	FString Code;

	/** Why, for people. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	FString Message;
};

/** What one swap changed. */
USTRUCT(BlueprintType)
struct TERRAPORT_API FTerraportSwap
{
	GENERATED_BODY()

	/** The landing that is shown from this frame on. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int64 Landing = 0;

	/** Its inner part alone. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	bool bDegraded = false;

	/** Segments that appeared. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int32 Shown = 0;

	/** Segments that vanished. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int32 Hidden = 0;
};

/** Where the newest landing stands, for a progress ring or a fade. */
USTRUCT(BlueprintType)
struct TERRAPORT_API FTerraportStatus
{
	GENERATED_BODY()

	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	ETerraportLandingPhase Phase = ETerraportLandingPhase::None;

	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int64 Landing = 0;

	/** Share of it that came and was made drawable, 0 to 1. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	double Fraction = 0.0;

	/** Milliseconds from Land until all bytes were here; negative until then. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	double ReadyMs = -1.0;

	/** Milliseconds from Land until it could be shown; negative until then. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	double PresentableMs = -1.0;

	/** Why it was refused. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	FString Refusal;
};

/** Counters, for an overlay. */
USTRUCT(BlueprintType)
struct TERRAPORT_API FTerraportStats
{
	GENERATED_BODY()

	/** Bytes of detail that came, over all connections. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int64 PayloadBytes = 0;

	/** Bytes of payload held in memory, to be shown again without the network. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int64 HeldBytes = 0;

	/** Segments that are ready to be drawn, shown or not. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int32 Segments = 0;

	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int32 VisibleSegments = 0;

	/** Triangles shown, base included. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int64 VisibleTriangles = 0;

	/** Estimate of GPU memory, bytes. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int64 GpuBytes = 0;

	/** Longest time of one frame on the game thread since the last call, milliseconds. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	double MaxFrameMs = 0.0;
};

/** A point of the ground that is shown. */
USTRUCT(BlueprintType)
struct TERRAPORT_API FTerraportGroundHit
{
	GENERATED_BODY()

	/** World space, centimetres. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	FVector Location = FVector::ZeroVector;

	/** World space, unit, outwards. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	FVector Normal = FVector::ZeroVector;

	/** Centimetres from the start of the ray. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	double DistanceCm = 0.0;

	/** Segment id, or -1 for the base. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int32 Segment = -1;
};

/** Answer of the server to a pick: what full detail has there, loaded or not. */
USTRUCT(BlueprintType)
struct TERRAPORT_API FTerraportPick
{
	GENERATED_BODY()

	/** Number that Pick returned. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int64 Request = 0;

	/** Whether something was met; else nothing below counts. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	bool bHit = false;

	/** World space, centimetres. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	FVector Location = FVector::ZeroVector;

	/** World space, unit. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	FVector Normal = FVector::ZeroVector;

	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int32 Segment = 0;

	/** Region of the face, in this version of the scene. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int32 Region = 0;

	/** What people call the region; text of theirs, to be shown as text. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	FString Label;

	/** Metres in the survey's own vertical reference. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	double HeightM = 0.0;

	/** The survey's attributes there, by name. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	TMap<FString, double> Attributes;
};

/** A named region, and where to stand to see it. */
USTRUCT(BlueprintType)
struct TERRAPORT_API FTerraportPlace
{
	GENERATED_BODY()

	/** What people call it; several may have one name. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	FString Label;

	/** Its number in this version, as picks have it. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	int32 Region = 0;

	/** Square metres; 0 where the scene does not say. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	double AreaM2 = 0.0;

	/** World space: on the ground where bIsView, else the region's middle. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	FVector Location = FVector::ZeroVector;

	/** World yaw of who looks at it, degrees; counts with bIsView. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	double YawDegrees = 0.0;

	/** Radius of a landing that shows it, metres. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	double RadiusM = 0.0;

	/** The place was chosen for its view. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	bool bIsView = false;
};

/** A coarser piece of ground that a region is part of: the field's farm, the farm's valley. */
USTRUCT(BlueprintType)
struct TERRAPORT_API FTerraportCoarserPiece
{
	GENERATED_BODY()

	/** What most of its named ground is called; empty where none has a name. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	FString Label;

	/** Its regions, ascending. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	TArray<int32> Regions;

	/** Square metres. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	double AreaM2 = 0.0;

	/** What uniting them costs, from 1: more is coarser. */
	UPROPERTY(BlueprintReadOnly, Category = "Terraport")
	double Cost = 0.0;
};
