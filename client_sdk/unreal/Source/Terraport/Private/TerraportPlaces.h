#pragma once

#include "CoreMinimal.h"

#include "Core/Basics.h"
#include "GameFramework/Actor.h"
#include "TerraportAxes.h"

/** Places of the world and of a scene's frame, by the scene's actor. */
namespace TerraportPlaces
{
/** A world location in the scene's frame, metres. */
inline terraport::Vec3 ScenePointOf(const AActor& Actor, const FVector& WorldLocation)
{
	const FVector Local = Actor.GetActorTransform().InverseTransformPosition(WorldLocation);
	const double Unreal[3] = {Local.X, Local.Y, Local.Z};
	double Scene[3];
	TerraportAxes::PointToScene(Unreal, Scene);
	return terraport::Vec3{Scene[0], Scene[1], Scene[2]};
}

inline FVector WorldOf(const AActor& Actor, const terraport::Vec3& ScenePoint)
{
	const double Scene[3] = {ScenePoint.x, ScenePoint.y, ScenePoint.z};
	double Unreal[3];
	TerraportAxes::PointToUnreal(Scene, Unreal);
	return Actor.GetActorTransform().TransformPosition(FVector(Unreal[0], Unreal[1], Unreal[2]));
}

inline FVector WorldDirectionOf(const AActor& Actor, const terraport::Vec3& Direction)
{
	const double Scene[3] = {Direction.x, Direction.y, Direction.z};
	double Unreal[3];
	TerraportAxes::DirectionToUnreal(Scene, Unreal);
	return Actor.GetActorTransform().TransformVectorNoScale(FVector(Unreal[0], Unreal[1], Unreal[2]));
}

inline terraport::Vec3 SceneDirectionOf(const AActor& Actor, const FVector& WorldDirection)
{
	const FVector Local = Actor.GetActorTransform().InverseTransformVectorNoScale(WorldDirection);
	const double Unreal[3] = {Local.X, Local.Y, Local.Z};
	double Scene[3];
	TerraportAxes::DirectionToScene(Unreal, Scene);
	return terraport::Vec3{Scene[0], Scene[1], Scene[2]};
}
} // namespace TerraportPlaces
