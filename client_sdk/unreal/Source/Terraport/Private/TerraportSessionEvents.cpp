#include "TerraportSession.h"

#include "TerraportAxes.h"
#include "TerraportLog.h"
#include "TerraportScene.h"
#include "TerraportText.h"

#include <algorithm>

// What a session tells: the core's news in the words of Blueprint, world space and centimetres.

namespace
{
FVector PointOf(const FTransform& Frame, const terraport::Vec3& Place)
{
	const double Scene[3] = {Place.x, Place.y, Place.z};
	double Out[3];
	TerraportAxes::PointToUnreal(Scene, Out);
	return Frame.TransformPosition(FVector(Out[0], Out[1], Out[2]));
}

FVector DirectionOf(const FTransform& Frame, const terraport::Vec3& Direction)
{
	const double Scene[3] = {Direction.x, Direction.y, Direction.z};
	double Out[3];
	TerraportAxes::DirectionToUnreal(Scene, Out);
	return Frame.TransformVectorNoScale(FVector(Out[0], Out[1], Out[2]));
}
} // namespace

void FTerraportSession::TellSwaps()
{
	std::vector<terraport::SceneSwap> Now;
	Now.swap(Swaps);
	for (const terraport::SceneSwap& Change : Now)
	{
		FTerraportSwap Swap;
		Swap.Landing = Change.landing;
		Swap.bDegraded = Change.degraded;
		Swap.Shown = int32(Change.shown.size());
		Swap.Hidden = int32(Change.hidden.size());
		Owner.OnShown.Broadcast(Swap);
		if (bEnded)
		{
			return;
		}
	}
}

void FTerraportSession::TellPresentable()
{
	if (!Stage || Owner.bAutoShow || !Stage->isPresentable())
	{
		return;
	}
	const terraport::LandingStatus Status = Stage->status();
	const bool bInFull = Status.phase == terraport::LandingPhase::Presentable;
	if (Status.landing != ToldPresentable || (bInFull && !bToldPresentableInFull))
	{
		ToldPresentable = Status.landing;
		bToldPresentableInFull = bInFull;
		Owner.OnPresentable.Broadcast(Status.landing);
	}
}

void FTerraportSession::Tell(const terraport::StreamEvent& Event)
{
	switch (Event.kind)
	{
	case terraport::EventKind::Link:
		TellLink(Event.link);
		break;
	case terraport::EventKind::Planned:
	{
		FTerraportPlan Plan;
		Plan.Landing = Event.landing;
		Plan.RadiusM = Event.plan.radiusM;
		Plan.EffectiveRadiusM = Event.plan.effectiveRadiusM;
		Plan.LoadSegments = int32(Event.plan.load.size());
		Plan.KeptSegments = int32(Event.plan.keep.size());
		Plan.LoadBytes = int64(Event.plan.loadBytes);
		Plan.Triangles = int64(Event.plan.totalTriangles);
		Plan.OmittedSegments = int32(Event.plan.omittedSegments);
		Owner.OnPlan.Broadcast(Plan);
		break;
	}
	case terraport::EventKind::Ready:
	{
		FTerraportReady Ready;
		Ready.Landing = Event.landing;
		Ready.Segments = int32(Event.segments.size());
		Ready.Missing = int32(Event.missing.size());
		Ready.ElapsedMs = Event.elapsedMs;
		Ready.PayloadBytes = int64(Event.payloadBytes);
		Owner.OnReady.Broadcast(Ready);
		break;
	}
	case terraport::EventKind::Degraded:
		Owner.OnDegraded.Broadcast(Event.landing);
		break;
	case terraport::EventKind::Refused:
		// What ends a connection is told by the link that follows, which also says whether it is for good.
		if (!Event.fatal)
		{
			TellFailure(Event.code, Event.message, Event.landing, false);
		}
		break;
	case terraport::EventKind::Picked:
	{
		FTerraportPick Pick;
		Pick.Request = int64(Event.request);
		Pick.bHit = Event.hit.has_value();
		if (Event.hit)
		{
			const FTransform Frame = Owner.GetActorTransform();
			Pick.Location = PointOf(Frame, Event.hit->position);
			Pick.Normal = DirectionOf(Frame, Event.hit->normal);
			Pick.Segment = int32(Event.hit->segment);
			Pick.Region = int32(Event.hit->region);
			Pick.Label = Event.hit->label ? TerraportText::FromUtf8(*Event.hit->label) : FString();
			Pick.HeightM = Event.hit->heightM;
			for (const auto& Entry : Event.hit->attributes)
			{
				Pick.Attributes.Add(TerraportText::FromUtf8(Entry.first), Entry.second);
			}
		}
		Owner.OnPicked.Broadcast(Pick);
		break;
	}
	case terraport::EventKind::PickRefused:
		TellFailure(Event.code, Event.message, 0, false);
		break;
	case terraport::EventKind::Notice:
		UE_LOG(LogTerraport, Log, TEXT("the server says: %s"), *TerraportText::FromUtf8(Event.noticeKind));
		break;
	default:
		break;
	}
}

void FTerraportSession::TellLink(const terraport::LinkState& Link)
{
	FTerraportLink News;
	switch (Link.phase)
	{
	case terraport::LinkPhase::Connecting:
		News.State = ETerraportLink::Connecting;
		break;
	case terraport::LinkPhase::Open:
		News.State = ETerraportLink::Open;
		break;
	case terraport::LinkPhase::Waiting:
		News.State = ETerraportLink::Waiting;
		break;
	case terraport::LinkPhase::Closed:
		News.State = ETerraportLink::Closed;
		break;
	}
	News.Attempt = int32(Link.attempt);
	News.RetryInS = Link.retryInMs / 1000.0;
	News.CloseCode = Link.closeCode;
	News.Code = TerraportText::FromUtf8(Link.code);
	News.Message = TerraportText::FromUtf8(Link.message);
	Owner.OnLink.Broadcast(News);
	if (!bEnded && Link.phase == terraport::LinkPhase::Closed && Link.code != "closed")
	{
		TellFailure(Link.code, Link.message, 0, true);
	}
}

void FTerraportSession::TellFailure(const std::string& Code, const std::string& Message, int64 Landing, bool bFatal)
{
	FTerraportFailure Failure;
	Failure.Code = TerraportText::FromUtf8(Code);
	Failure.Message = TerraportText::FromUtf8(Message);
	Failure.Landing = std::max<int64>(Landing, 0);
	Failure.bFatal = bFatal;
	UE_LOG(LogTerraport, Warning, TEXT("%s: %s"), *Failure.Code, *Failure.Message);
	Owner.OnFailed.Broadcast(Failure);
}
