#include "TerraportSession.h"

#include "GameFramework/Actor.h"
#include "TerraportAxes.h"
#include "TerraportLog.h"
#include "TerraportText.h"

#include <algorithm>

// What a session reports: the core's events in the types of Blueprint, world space and centimetres. After each call of Host the
// session may have ended: a listener has closed the scene.

namespace
{
FVector PointOf(const FTransform& Frame, const terraport::Vec3& ScenePoint)
{
	const double Scene[3] = {ScenePoint.x, ScenePoint.y, ScenePoint.z};
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
FTerraportPlan PlanOf(const terraport::StreamEvent& Event)
{
	FTerraportPlan Plan;
	Plan.Landing = Event.landing;
	Plan.RadiusM = Event.plan.radiusM;
	Plan.EffectiveRadiusM = Event.plan.effectiveRadiusM;
	Plan.CoarseRadiusM = Event.plan.coarseRadiusM.value_or(0.0);
	Plan.LoadSegments = int32(Event.plan.load.size());
	Plan.KeptSegments = int32(Event.plan.keep.size());
	Plan.LoadBytes = int64(Event.plan.loadBytes);
	Plan.Triangles = int64(Event.plan.totalTriangles);
	Plan.OmittedSegments = int32(Event.plan.omittedSegments);
	return Plan;
}

FTerraportReady ReadyOf(const terraport::StreamEvent& Event)
{
	FTerraportReady Ready;
	Ready.Landing = Event.landing;
	Ready.Segments = int32(Event.segments.size());
	Ready.Missing = int32(Event.missing.size());
	Ready.ElapsedMs = Event.elapsedMs;
	Ready.PayloadBytes = int64(Event.payloadBytes);
	return Ready;
}

/** `Frame`: the actor's, from the scene to the world. */
FTerraportPick PickOf(const terraport::StreamEvent& Event, const FTransform& Frame)
{
	FTerraportPick Pick;
	Pick.Request = int64(Event.request);
	Pick.bHit = Event.hit.has_value();
	if (Event.hit)
	{
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
	return Pick;
}
} // namespace

void FTerraportSession::ReportSwaps()
{
	std::vector<terraport::SceneSwap> Batch;
	Batch.swap(Swaps);
	for (const terraport::SceneSwap& Change : Batch)
	{
		FTerraportSwap Swap;
		Swap.Landing = Change.landing;
		Swap.bDegraded = Change.degraded;
		Swap.Shown = int32(Change.shown.size());
		Swap.Hidden = int32(Change.hidden.size());
		Host->OnShown(Swap);
		if (bEnded)
		{
			return;
		}
	}
}

void FTerraportSession::ReportPresentable()
{
	if (!Stage || Host->IsAutoShow() || !Stage->isPresentable())
	{
		return;
	}
	const terraport::LandingStatus Status = Stage->status();
	const bool bInFull = Status.phase == terraport::LandingPhase::Presentable;
	if (Status.landing != ReportedPresentable || (bInFull && !bReportedPresentableInFull))
	{
		ReportedPresentable = Status.landing;
		bReportedPresentableInFull = bInFull;
		Host->OnPresentable(Status.landing);
	}
}

void FTerraportSession::ReportUnread()
{
	const terraport::ImageType Unread = Renderer->TakeUnread();
	if (Unread == terraport::ImageType::None || bReportedUnread)
	{
		return;
	}
	bReportedUnread = true;
	ReportFailure("unread_image",
		std::string("images of type ") + terraport::mediaTypeOf(Unread) +
			" could not be read, expected whole ones of image/jpeg, image/png or image/ktx2 (ETC1S): such ground is drawn in "
			"its regions' mean "
			"colours; "
			"build the scene with JPEG textures or vertex colours (docs/how-to/unreal.md)",
		0, false);
}

void FTerraportSession::Report(const terraport::StreamEvent& Event)
{
	switch (Event.kind)
	{
	case terraport::EventKind::Link:
		ReportLink(Event.link);
		break;
	case terraport::EventKind::Planned:
		Host->OnPlan(PlanOf(Event));
		break;
	case terraport::EventKind::Ready:
		Host->OnReady(ReadyOf(Event));
		break;
	case terraport::EventKind::Degraded:
		Host->OnDegraded(Event.landing);
		break;
	case terraport::EventKind::Refused:
		// What ends a connection is reported by the link event that follows, which also says whether it is for good.
		if (!Event.fatal)
		{
			ReportFailure(Event.code, Event.message, Event.landing, false);
		}
		break;
	case terraport::EventKind::Picked:
		Host->OnPicked(PickOf(Event, Owner.GetActorTransform()));
		break;
	case terraport::EventKind::PickRefused:
		ReportFailure(Event.code, Event.message, 0, false);
		break;
	case terraport::EventKind::Notice:
		UE_LOG(LogTerraport, Log, TEXT("the server says: %s"), *TerraportText::FromUtf8(Event.noticeKind));
		break;
	default:
		break;
	}
}

void FTerraportSession::ReportLink(const terraport::LinkState& Link)
{
	FTerraportLink Event;
	switch (Link.phase)
	{
	case terraport::LinkPhase::Connecting:
		Event.State = ETerraportLink::Connecting;
		break;
	case terraport::LinkPhase::Open:
		Event.State = ETerraportLink::Open;
		break;
	case terraport::LinkPhase::Waiting:
		Event.State = ETerraportLink::Waiting;
		break;
	case terraport::LinkPhase::Closed:
		Event.State = ETerraportLink::Closed;
		break;
	}
	Event.Attempt = int32(Link.attempt);
	Event.RetryInS = Link.retryInMs / 1000.0;
	Event.CloseCode = Link.closeCode;
	Event.Code = TerraportText::FromUtf8(Link.code);
	Event.Message = TerraportText::FromUtf8(Link.message);
	Host->OnLink(Event);
	if (!bEnded && Link.phase == terraport::LinkPhase::Closed && Link.code != "closed")
	{
		ReportFailure(Link.code, Link.message, 0, true);
	}
}

void FTerraportSession::ReportFailure(const std::string& Code, const std::string& Message, int64 Landing, bool bFatal)
{
	FTerraportFailure Failure;
	Failure.Code = TerraportText::FromUtf8(Code);
	Failure.Message = TerraportText::FromUtf8(Message);
	Failure.Landing = std::max<int64>(Landing, 0);
	Failure.bFatal = bFatal;
	UE_LOG(LogTerraport, Warning, TEXT("%s: %s"), *Failure.Code, *Failure.Message);
	Host->OnFailed(Failure);
}
