#pragma once

#include "CoreMinimal.h"

#include "Core/Ground.h"
#include "TerraportKeeper.h"

#include <vector>

class AActor;
class UProceduralMeshComponent;

/**
 * Ground that is solid around somebody's feet: what is shown there, detail and base, hidden faces not. A bounded number of
 * faces a time, cooked on the engine's threads; what was solid before stays until then. Game thread.
 */
class FTerraportFeet final
{
public:
	FTerraportFeet(AActor& Owner, ITerraportKeeper& Keeper);
	/** Destroys the component. */
	~FTerraportFeet();
	FTerraportFeet(const FTerraportFeet&) = delete;
	FTerraportFeet& operator=(const FTerraportFeet&) = delete;

	/** Once a frame: take the ground anew where it has changed, or the feet (scene frame) have left the cube's inner half. */
	void Step(const terraport::ShownGround& Ground, const terraport::Vec3& Feet, double HalfM, int32 MaxFaces);

private:
	bool HasMovedOn(const terraport::Vec3& Feet) const;
	void Fill();

	AActor& Owner;
	ITerraportKeeper& Keeper;
	UProceduralMeshComponent* Component = nullptr;
	/** Scene frame, three corners a face. */
	std::vector<float> Corners;
	terraport::Vec3 Centre;
	double ReachM = 0.0;
	uint64 Changes = 0;
};
