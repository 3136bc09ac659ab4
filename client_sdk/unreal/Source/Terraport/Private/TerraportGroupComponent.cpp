#include "TerraportGroupComponent.h"

#include "Engine/World.h"
#include "EngineUtils.h"
#include "GameFramework/Actor.h"
#include "TerraportPlaces.h"
#include "TerraportScene.h"
#include "TerraportSession.h"
#include "TerraportText.h"
#include "TerraportUserComponent.h"

#include "Terraport/GroupFollower.h"

#include <cstdint>
#include <vector>

namespace
{
TArray<int64> NumbersOf(const std::vector<std::uint32_t>& Members)
{
	TArray<int64> Numbers;
	for (const std::uint32_t Member : Members)
	{
		Numbers.Add(int64(Member));
	}
	return Numbers;
}

FTerraportGroup GroupOf(const AActor& Actor, const terraport::GroupFacts& Facts)
{
	FTerraportGroup Group;
	Group.Name = TerraportText::FromUtf8(Facts.name);
	Group.Member = int64(Facts.member);
	Group.bGuide = Facts.role == terraport::GroupRole::Guide;
	for (const terraport::GroupMember& One : Facts.members)
	{
		FTerraportGroupMember Member;
		Member.Member = int64(One.member);
		Member.Name = TerraportText::FromUtf8(One.name);
		Member.bGuide = One.role == terraport::GroupRole::Guide;
		Member.bPresent = One.isPresent;
		Member.bHasLanded = One.position.has_value();
		if (Member.bHasLanded)
		{
			Member.Location = TerraportPlaces::WorldOf(Actor, *One.position);
		}
		Group.Members.Add(Member);
	}
	Group.Gathering = int64(Facts.gathering.number);
	Group.Location = TerraportPlaces::WorldOf(Actor, Facts.gathering.position);
	Group.RadiusM = Facts.gathering.radiusM;
	Group.bOver = Facts.gathering.isOver;
	Group.Ready = NumbersOf(Facts.gathering.ready);
	Group.Degraded = NumbersOf(Facts.gathering.degraded);
	Group.Missing = NumbersOf(Facts.gathering.missing);
	return Group;
}
} // namespace

UTerraportGroupComponent::UTerraportGroupComponent()
{
	PrimaryComponentTick.bCanEverTick = true;
}

bool UTerraportGroupComponent::Join(const FString& Name, bool bAsGuide, const FString& OwnName)
{
	FTerraportSession* Session = FindSession();
	const terraport::GroupRole Role = bAsGuide ? terraport::GroupRole::Guide : terraport::GroupRole::Member;
	return Session != nullptr &&
		Session->GetFollower()->join(TerraportText::ToUtf8(Name), Role, TerraportText::ToUtf8(OwnName)).isOk();
}

void UTerraportGroupComponent::Leave()
{
	if (FTerraportSession* Session = FindSession())
	{
		Session->GetFollower()->leave();
	}
}

bool UTerraportGroupComponent::Gather(const FVector& WorldLocation, double RadiusM)
{
	FTerraportSession* Session = FindSession();
	return Session != nullptr && Session->GetFollower()->group() &&
		Session->Gather(TerraportPlaces::ScenePointOf(*Scene, WorldLocation), RadiusM);
}

bool UTerraportGroupComponent::GoThere()
{
	FTerraportSession* Session = FindSession();
	return Session != nullptr && Session->GoToGroup() > 0;
}

FTerraportGroup UTerraportGroupComponent::GetGroup() const
{
	const FTerraportSession* Session = IsValid(Scene) ? Scene->GetSession() : nullptr;
	const terraport::GroupFollower* Follower = Session != nullptr ? Session->GetFollower() : nullptr;
	return Follower != nullptr && Follower->group() ? GroupOf(*Scene, *Follower->group()) : FTerraportGroup();
}

void UTerraportGroupComponent::TickComponent(
	float DeltaTime, ELevelTick TickType, FActorComponentTickFunction* ThisTickFunction)
{
	Super::TickComponent(DeltaTime, TickType, ThisTickFunction);
	FTerraportSession* Session = FindSession();
	if (Session == nullptr)
	{
		return;
	}
	Session->GetFollower()->setFollows(bFollow);
	if (IsValid(User))
	{
		Session->GetFollower()->setLander([this](const terraport::GroupGathering& There) {
			return User->TeleportTo(TerraportPlaces::WorldOf(*Scene, There.position)) ? Scene->GetStatus().Landing
																					  : terraport::kNoLanding;
		});
	}
	else
	{
		Session->GetFollower()->setLander(nullptr);
	}
	for (const terraport::StreamEvent& Event : Session->TakeGroupNews())
	{
		// In each round: a listener may have closed the scene.
		const FTerraportGroup Group = Event.group && IsValid(Scene) ? GroupOf(*Scene, *Event.group) : FTerraportGroup();
		if (Event.kind == terraport::EventKind::GroupRefused)
		{
			OnRefused.Broadcast(TerraportText::FromUtf8(Event.message));
		}
		OnChanged.Broadcast(Group);
		if (Event.kind == terraport::EventKind::GroupCalled)
		{
			OnCalled.Broadcast(Group);
		}
		if (Event.kind == terraport::EventKind::GroupGathered)
		{
			OnGathered.Broadcast(Group);
		}
	}
}

void UTerraportGroupComponent::EndPlay(const EEndPlayReason::Type EndPlayReason)
{
	// Nobody would answer for this member any more.
	if (FTerraportSession* Session = FindSession())
	{
		Session->GetFollower()->leave();
		Session->GetFollower()->setLander(nullptr);
	}
	Super::EndPlay(EndPlayReason);
}

FTerraportSession* UTerraportGroupComponent::FindSession()
{
	if (!IsValid(Scene) && GetWorld() != nullptr)
	{
		TActorIterator<ATerraportScene> First(GetWorld());
		Scene = First ? *First : nullptr;
	}
	FTerraportSession* Session = IsValid(Scene) ? Scene->GetSession() : nullptr;
	return Session != nullptr && Session->GetFollower() != nullptr ? Session : nullptr;
}
