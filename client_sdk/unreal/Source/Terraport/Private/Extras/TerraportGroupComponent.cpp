#include "TerraportGroupComponent.h"

#include "Engine/World.h"
#include "EngineUtils.h"
#include "GameFramework/Actor.h"
#include "TerraportPlaces.h"
#include "TerraportScene.h"
#include "TerraportSession.h"
#include "TerraportText.h"
#include "TerraportUserComponent.h"

#include <algorithm>
#include <cstdint>
#include <variant>
#include <vector>

/** The core's event, hidden from the public header. */
struct FTerraportGroupNews
{
	const terraport::GroupEvent& Event;
};

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
} // namespace

UTerraportGroupComponent::UTerraportGroupComponent()
{
	PrimaryComponentTick.bCanEverTick = true;
}

bool UTerraportGroupComponent::Join(const FString& Name, bool bAsGuide, const FString& OwnName)
{
	FTerraportSession* Session = FindSession();
	if (Session == nullptr || !Session->JoinGroup(TerraportText::ToUtf8(Name), bAsGuide, TerraportText::ToUtf8(OwnName)))
	{
		return false;
	}
	Forget();
	return true;
}

void UTerraportGroupComponent::Leave()
{
	if (FTerraportSession* Session = FindSession())
	{
		Session->GetSeat()->leave();
	}
	Forget();
}

bool UTerraportGroupComponent::Gather(const FVector& WorldLocation, double RadiusM)
{
	FTerraportSession* Session = FindSession();
	return Session != nullptr && !Group.Name.IsEmpty() &&
		Session->GetSeat()->gather(TerraportPlaces::ScenePointOf(*Scene, WorldLocation), RadiusM) != 0;
}

bool UTerraportGroupComponent::GoThere()
{
	if (FindSession() == nullptr || Group.Gathering == 0)
	{
		return false;
	}
	if (IsValid(User) && User->TeleportTo(Group.Location))
	{
		AwaitedLanding = Scene->GetStatus().Landing;
	}
	else
	{
		AwaitedLanding = Scene->Land(Group.Location, Group.RadiusM, Options);
	}
	bToldDegraded = false;
	return AwaitedLanding > 0;
}

FTerraportGroup UTerraportGroupComponent::GetGroup() const
{
	return Group;
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
	const std::vector<terraport::GroupEvent> Events = Session->TakeGroupEvents();
	for (const terraport::GroupEvent& Event : Events)
	{
		// In each round: a listener may have closed the scene.
		if (FindSession() == nullptr)
		{
			return;
		}
		Take(FTerraportGroupNews{Event});
	}
	TellArrival();
}

void UTerraportGroupComponent::Take(const FTerraportGroupNews& News)
{
	const terraport::GroupEvent& Event = News.Event;
	if (const auto* Refused = std::get_if<terraport::GroupRefused>(&Event))
	{
		OnRefused.Broadcast(TerraportText::FromUtf8(Refused->message));
		return;
	}
	if (const auto* Joined = std::get_if<terraport::Joined>(&Event))
	{
		Group.Name = TerraportText::FromUtf8(Joined->group);
		Group.Member = int64(Joined->member);
		Group.bGuide = Joined->isGuide;
	}
	else if (const auto* Roster = std::get_if<terraport::Roster>(&Event))
	{
		Group.Members.Reset();
		for (const terraport::Member& One : Roster->members)
		{
			FTerraportGroupMember Member;
			Member.Member = int64(One.member);
			Member.Name = TerraportText::FromUtf8(One.name);
			Member.bGuide = One.isGuide;
			Member.bPresent = One.isPresent;
			Member.bHasLanded = One.position.has_value();
			Member.Location = One.position ? TerraportPlaces::WorldOf(*Scene, *One.position) : FVector::ZeroVector;
			Group.Members.Add(Member);
		}
	}
	else if (const auto* Gathering = std::get_if<terraport::Gathering>(&Event))
	{
		Group.Gathering = int64(Gathering->gathering);
		Group.Location = TerraportPlaces::WorldOf(*Scene, Gathering->position);
		Group.RadiusM = Gathering->radiusM;
		Group.bOver = !Gathering->leftMs.has_value();
		Group.Ready.Reset();
		Group.Degraded.Reset();
		Group.Missing.Reset();
		Options = FTerraportLandOptions();
		Options.InnerRadiusM = Gathering->innerRadiusM.value_or(0.0);
		Options.DeadlineMs = int32(std::max(Gathering->leftMs.value_or(1u), 1u));
		AwaitedLanding = 0;
	}
	else if (const auto* Gathered = std::get_if<terraport::Gathered>(&Event))
	{
		Group.bOver = true;
		Group.Ready = NumbersOf(Gathered->ready);
		Group.Degraded = NumbersOf(Gathered->degraded);
		Group.Missing = NumbersOf(Gathered->missing);
	}
	const FTerraportGroup Now = Group;
	OnChanged.Broadcast(Now);
	if (std::holds_alternative<terraport::Gathering>(Event))
	{
		OnCalled.Broadcast(Now);
		FTerraportSession* Session = FindSession();
		if (bFollow)
		{
			(void)GoThere();
		}
		else if (Session != nullptr)
		{
			Session->GetSeat()->arrived(std::uint32_t(Now.Gathering), terraport::Arrival::Declined);
		}
	}
	else if (std::holds_alternative<terraport::Gathered>(Event))
	{
		OnGathered.Broadcast(Now);
	}
}

/** Tell the group once the landing that it asked for can be shown, or comes to nothing. */
void UTerraportGroupComponent::TellArrival()
{
	FTerraportSession* Session = FindSession();
	if (AwaitedLanding == 0 || Session == nullptr)
	{
		return;
	}
	terraport::Seat& Seat = *Session->GetSeat();
	const std::uint32_t Gathering = std::uint32_t(Group.Gathering);
	const FTerraportStatus Status = Scene->GetStatus();
	using EPhase = ETerraportLandingPhase;
	// A newer landing: the user went elsewhere.
	if (Status.Landing != AwaitedLanding || Status.Phase == EPhase::Refused)
	{
		Seat.arrived(Gathering, terraport::Arrival::Declined);
		AwaitedLanding = 0;
	}
	else if (Status.Phase == EPhase::Presentable || Status.Phase == EPhase::Shown)
	{
		Seat.arrived(Gathering, terraport::Arrival::Ready);
		AwaitedLanding = 0;
	}
	else if (!bToldDegraded && (Status.Phase == EPhase::PresentableDegraded || Status.Phase == EPhase::ShownDegraded))
	{
		Seat.arrived(Gathering, terraport::Arrival::Degraded);
		bToldDegraded = true;
	}
}

void UTerraportGroupComponent::EndPlay(const EEndPlayReason::Type EndPlayReason)
{
	// Nobody would answer for this member any more.
	Leave();
	Super::EndPlay(EndPlayReason);
}

void UTerraportGroupComponent::Forget()
{
	Group = FTerraportGroup();
	AwaitedLanding = 0;
}

FTerraportSession* UTerraportGroupComponent::FindSession()
{
	if (!IsValid(Scene) && GetWorld() != nullptr)
	{
		TActorIterator<ATerraportScene> First(GetWorld());
		Scene = First ? *First : nullptr;
	}
	FTerraportSession* Session = IsValid(Scene) ? Scene->GetSession() : nullptr;
	return Session != nullptr && Session->GetSeat() != nullptr ? Session : nullptr;
}
