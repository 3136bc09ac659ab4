#include "TerraportScene.h"

#include "Engine/World.h"

// The base and a landing in the editor's viewport. What is made for it is transient: neither saved nor copied with the level.

namespace
{
/** Of the radius: so far the camera goes before the preview lands anew. */
constexpr double MovedShare = 0.25;
} // namespace

bool ATerraportScene::ShouldTickIfViewportsOnly() const
{
	return bPreviewInEditor;
}

void ATerraportScene::TickPreview()
{
	const UWorld* World = GetWorld();
	if (!bPreviewInEditor || World->ViewLocationsRenderedLastFrame.Num() == 0)
	{
		return;
	}
	if (!Session.IsValid())
	{
		PreviewedAt.Reset();
		Open();
	}
	if (!IsOpen())
	{
		return;
	}
	const FVector Camera = World->ViewLocationsRenderedLastFrame[0];
	if (PreviewedAt.IsSet() && (Camera - *PreviewedAt).Size() < MovedShare * PreviewRadiusM * 100.0)
	{
		return;
	}
	// Below the camera, which mostly hangs high above a level. Before the base is drawn there is no ground yet, and beside the
	// survey there is none at all: asked for again by the next tick.
	FTerraportGroundHit Ground;
	if (GroundAt(Camera, Ground))
	{
		PreviewedAt = Camera;
		Land(Ground.Location, PreviewRadiusM, FTerraportLandOptions());
	}
}

void ATerraportScene::Destroyed()
{
	Close();
	Super::Destroyed();
}

#if WITH_EDITOR
void ATerraportScene::PostEditChangeProperty(FPropertyChangedEvent& Event)
{
	Super::PostEditChangeProperty(Event);
	const UWorld* World = GetWorld();
	if (World != nullptr && World->WorldType == EWorldType::Editor)
	{
		// By the next tick it is opened with the properties as they are now, or it stays away.
		Close();
	}
}
#endif
