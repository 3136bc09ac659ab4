#pragma once

#include "CoreMinimal.h"

#include "TerraportSettings.generated.h"

/** What a device is asked to hold: the bounds of a landing and of what is kept beside it. The same numbers as in the web
 * client. */
UENUM(BlueprintType)
enum class ETerraportDevice : uint8
{
	/** 6 million triangles, 4,096 segments a landing; 1,024 MiB on the graphics in all. */
	Desktop,
	/** 900,000 triangles, 512 segments a landing; 512 MiB in all: two eyes on a phone's graphics. */
	Headset,
	/** 1.5 million triangles, 1,024 segments a landing; 256 MiB in all. */
	Phone,
	/** What CustomBudgets says. */
	Custom,
};

/** Bounds of everything that can grow with the length of a visit. The server keeps those of a landing: nearest first until the
 * next segment would exceed one. */
USTRUCT(BlueprintType)
struct TERRAPORT_API FTerraportBudgets
{
	GENERATED_BODY()

	/** Triangles of a landing. More: a larger sharp circle. Fewer: more frames per second. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport", meta = (ClampMin = "1000"))
	int64 MaxTriangles = 6000000;

	/** MiB of everything on the graphics: base, what is shown, what is coming, what an aim brought; textures with their mips,
	 * and what a mesh keeps in main memory beside. Lowered to an eighth of the device's memory where that is less. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport", meta = (ClampMin = "16", ClampMax = "65536"))
	int32 MaxGpuMebibytes = 1024;

	/** Segments of a landing; each in view is a draw call. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport", meta = (ClampMin = "1"))
	int32 MaxSegments = 4096;

	/** MiB of payload kept in main memory beside what is shown, so that coming back needs no network. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport", meta = (ClampMin = "0", ClampMax = "8192"))
	int32 CacheMiB = 256;

	/** MiB of payload kept on disk from one run to the next (Saved/Terraport), of all scenes; 0 keeps none. Whoever may read
	 * that folder may read it. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport", meta = (ClampMin = "0", ClampMax = "65536"))
	int32 DiskMiB = 1024;

	/** MiB of payload under way at most. More: long links are used in full. Less: a landing that is given up costs less. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Terraport", meta = (ClampMin = "1", ClampMax = "256"))
	int32 CreditMiB = 16;

	/** The bounds of a class of devices; for Custom those of a desktop. */
	static FTerraportBudgets For(ETerraportDevice Device);
};

/** How vertex colours are coded for the material's Vertex Color node. */
UENUM(BlueprintType)
enum class ETerraportVertexColours : uint8
{
	/** Eight bits of sRGB: every level of the survey, exactly. The material must turn them to linear light; the one of
	 * terraport_materials.py does. */
	Srgb,
	/** Eight bits of linear light: any material takes them as they are, and dark levels run together. */
	Linear,
};
