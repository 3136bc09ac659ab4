#include "TerraportSession.h"

#include "HAL/FileManager.h"
#include "HAL/PlatformMemory.h"
#include "HAL/PlatformTime.h"
#include "Misc/Paths.h"
#include "Modules/ModuleManager.h"
#include "Tasks/Task.h"
#include "TerraportGroundPiece.h"
#include "TerraportLog.h"
#include "TerraportPlaces.h"
#include "TerraportScene.h"
#include "TerraportText.h"
#include "TerraportWebSocket.h"

#include <algorithm>
#include <utility>

namespace
{
/** Bytes of the network that one frame takes in: copied in less than a tenth of a millisecond; 37 MB/s at 72 Hz. */
constexpr std::size_t MaxPumpBytes = 512 * 1024;
/** Waits between attempts to load the base, milliseconds: doubled each time. */
constexpr double FirstRetryMs = 1000.0;
constexpr double MaxRetryMs = 30000.0;
constexpr uint64 Mebibyte = 1024 * 1024;

double NowMilliseconds()
{
	return FPlatformTime::Seconds() * 1000.0;
}

/** Nothing that a second attempt could change. */
bool IsFinal(const std::string& Code)
{
	return Code != "unreachable" && Code != "draining" && Code != "too_many";
}

FTerraportMaterials MaterialsOf(const ATerraportScene& Scene)
{
	FTerraportMaterials Chosen;
	Chosen.Colour = Scene.ColourMaterial;
	Chosen.Texture = Scene.TextureMaterial;
	Chosen.BaseColour = Scene.BaseColourMaterial;
	Chosen.BaseTexture = Scene.BaseTextureMaterial;
	Chosen.TextureParameter = Scene.TextureParameter;
	Chosen.PushParameter = Scene.PushParameter;
	Chosen.Coding = Scene.VertexColours;
	return FTerraportMaterials::Find(Chosen, Scene.bLit, Scene.GetName());
}

/** What is stated, or an eighth of the device's memory. */
uint64 GpuShareBytes(const FTerraportBudgets& Budgets)
{
	const uint64 Stated = uint64(std::max(Budgets.MaxGpuMebibytes, 1)) * Mebibyte;
	const uint64 Device = FPlatformMemory::GetConstants().TotalPhysical / 8;
	return Device > 0 ? std::min(Stated, Device) : Stated;
}

/** The cache opens files without the engine, so its path must be absolute. FPaths::ConvertRelativePathToFull gives a relative
 * one on Android and iOS; this is what the platform's own file layer writes to. */
std::string DiskFolder()
{
	const FString Saved = FPaths::ProjectSavedDir() / TEXT("Terraport");
	return TerraportText::ToUtf8(IFileManager::Get().ConvertToAbsolutePathForExternalAppForWrite(*Saved));
}
} // namespace

/** A scene that is being loaded; what the worker makes is shared with it. */
struct FTerraportSession::FLoading
{
	struct FMade
	{
		TSharedPtr<FTerraportBase, ESPMode::ThreadSafe> Base;
	};

	FTerraportHttp Http;
	std::shared_ptr<FMade> Made = std::make_shared<FMade>();
	std::unique_ptr<terraport::SceneLoader> Loader;
};

FTerraportSession::FTerraportSession(
	ATerraportScene& InScene, const FTerraportTokenProvider& InTokenProvider, TSet<TObjectPtr<UObject>>& ReferencedObjects)
	: Scene(InScene), Keeper(ReferencedObjects),
	  Budgets(InScene.Device == ETerraportDevice::Custom ? InScene.CustomBudgets : FTerraportBudgets::For(InScene.Device)),
	  TokenProvider(InTokenProvider), Token(TerraportText::ToUtf8(InScene.Token)), Materials(MaterialsOf(InScene))
{
	// Worker threads may only look it up.
	FModuleManager::Get().LoadModule(TEXT("ImageWrapper"));
	Renderer = std::make_unique<FTerraportRenderer>(Scene, Keeper, Materials, Scene.bCastShadows || Scene.bLit);
	StartLoading();
}

FTerraportSession::~FTerraportSession()
{
	End();
}

void FTerraportSession::End()
{
	if (bEnded)
	{
		return;
	}
	bEnded = true;
	if (Link)
	{
		Link->leave();
	}
	Loading.reset();
	Feet.reset();
	Stage.reset();
	Link.reset();
	Core.reset();
	Decodes.reset();
	Renderer.reset();
}

void FTerraportSession::Tick()
{
	const double StartMs = NowMilliseconds();
	const double EndMs = StartMs + double(Scene.FrameBudgetMs);
	PollLoading(StartMs);
	if (!bEnded && Link)
	{
		Link->pump(StartMs, MaxPumpBytes);
	}
	std::vector<FNews> All = std::exchange(Inbox, {});
	for (FNews& News : All)
	{
		if (!bEnded)
		{
			Handle(News, StartMs);
		}
	}
	if (bEnded)
	{
		return;
	}
	if (Stage)
	{
		Stage->setAutoShow(Scene.bAutoShow);
		Stage->update(NowMilliseconds, std::max(EndMs - NowMilliseconds(), 0.0));
	}
	Renderer->FreeSome(EndMs / 1000.0);
	MaxFrameMs = std::max(MaxFrameMs, NowMilliseconds() - StartMs);
	ReportDrawn();
}

// ---- commands

int64 FTerraportSession::Land(const terraport::Vec3& Position, double RadiusM, const terraport::LandOptions& Options)
{
	if (!Stage)
	{
		Pending = FPending{Position, RadiusM, Options};
		return 0;
	}
	Stage->setShowsCoarse(Scene.bShowsCoarse);
	return Stage->land(Position, RadiusM, Options, NowMilliseconds());
}

void FTerraportSession::Aim(const terraport::Vec3& Position, double RadiusM)
{
	if (Stage)
	{
		Stage->setShowsCoarse(Scene.bShowsCoarse);
		(void)Stage->aim(Position, RadiusM);
	}
}

int64 FTerraportSession::Pick(const terraport::Vec3& Origin, const terraport::Vec3& Direction)
{
	return Core ? Core->pick(Origin, Direction) : -1;
}

bool FTerraportSession::Show()
{
	const bool bShown = Stage && Stage->show();
	ReportDrawn();
	return bShown;
}

void FTerraportSession::Reconnect(const FString& NewToken)
{
	if (!NewToken.IsEmpty())
	{
		Token = TerraportText::ToUtf8(NewToken);
		TokenProvider = FTerraportTokenProvider();
	}
	if (Link)
	{
		Link->reconnect();
	}
	if ((!Stage || Stage->needsScene()) && !Loading)
	{
		LoadAttempt = 0;
		StartLoading();
	}
}

void FTerraportSession::StepFeet(const terraport::Vec3& Place, double HalfM, int32 MaxFaces)
{
	if (bEnded || !Stage)
	{
		return;
	}
	if (!Feet)
	{
		Feet = std::make_unique<FTerraportFeet>(Scene, Keeper);
	}
	Feet->Step(Stage->ground(), Place, HalfM, MaxFaces);
}

FTerraportStats FTerraportSession::TakeStats()
{
	FTerraportStats Stats;
	if (Stage)
	{
		const terraport::StageStats Drawn = Stage->stats();
		Stats.PayloadBytes = int64(Core->counts().payloadBytes);
		Stats.HeldBytes = int64(Core->cacheBytes());
		Stats.Segments = int32(Drawn.segments);
		Stats.VisibleSegments = int32(Drawn.visibleSegments);
		Stats.VisibleTriangles = int64(Drawn.visibleTriangles);
		Stats.GpuBytes = int64(Drawn.gpuBytes);
	}
	Stats.MaxFrameMs = std::exchange(MaxFrameMs, 0.0);
	return Stats;
}

bool FTerraportSession::JoinGroup(const std::string& Name, bool bAsGuide, const std::string& OwnName)
{
	if (!Core || !terraport::Seat::areNames(Name, OwnName))
	{
		return false;
	}
	// By an address that names the group, always: where several processes serve a scene, it leads to the one with the group
	// (docs/decisions/groups.md).
	Core->seat().leave();
	Link->setGroup(Name);
	return Core->seat().join(Name, bAsGuide, OwnName) != 0;
}

// ---- loading and connecting

std::string FTerraportSession::PresentToken() const
{
	return TokenProvider.IsBound() ? TerraportText::ToUtf8(TokenProvider.Execute()) : Token;
}

void FTerraportSession::StartLoading()
{
	RetryAtMs = 0.0;
	++LoadAttempt;
	Loading = std::make_unique<FLoading>();
	terraport::SceneLoader::Options Options;
	Options.url = TerraportText::ToUtf8(Scene.SceneUrl);
	Options.token = PresentToken();
	Options.version = Version;
	Options.runElsewhere = [](std::function<void()> Work) {
		UE::Tasks::Launch(TEXT("TerraportScene"), std::move(Work), UE::Tasks::ETaskPriority::BackgroundNormal);
	};
	Options.afterLoad = [Made = Loading->Made, Coding = Materials.Coding](
							terraport::Scene& Loaded) { Made->Base = FTerraportBase::Build(Loaded, Coding); };
	Loading->Loader = std::make_unique<terraport::SceneLoader>(Loading->Http, std::move(Options));
}

void FTerraportSession::PollLoading(double NowMs)
{
	if (!Loading)
	{
		if (RetryAtMs > 0.0 && NowMs >= RetryAtMs)
		{
			StartLoading();
		}
		return;
	}
	const terraport::SceneLoader::State State = Loading->Loader->pump();
	if (State == terraport::SceneLoader::State::Loading)
	{
		return;
	}
	const std::unique_ptr<FLoading> Over = std::move(Loading);
	const bool bDone = State == terraport::SceneLoader::State::Done;
	// The connection may have gone on to another version meanwhile: base and hidden faces are of one.
	if (bDone && (Version.empty() || Over->Loader->scene()->version == Version))
	{
		LoadAttempt = 0;
		TakeScene(*Over, NowMs);
		return;
	}
	const terraport::Status& Status = Over->Loader->status();
	// A version that the server has given up since: the next connection names a newer one, whose files are then asked for.
	const bool bGone = !Version.empty() && Status.code().compare(0, 7, "unknown") == 0;
	const bool bFinal = !bDone && IsFinal(Status.code()) && !bGone;
	if (!bFinal)
	{
		RetryAtMs = NowMs + std::min(FirstRetryMs * double(1 << std::min(LoadAttempt - 1, 10)), MaxRetryMs);
	}
	if (!bDone)
	{
		ReportFailure(Status.code(), Status.message(), 0, bFinal);
	}
}

void FTerraportSession::TakeScene(const FLoading& Loaded, double NowMs)
{
	const terraport::SharedScene NewScene = Loaded.Loader->scene();
	Renderer->BeginBase(Loaded.Made->Base.ToSharedRef());
	const bool bFirst = Stage == nullptr;
	if (bFirst)
	{
		Connect(Loaded.Loader->url(), *NewScene);
	}
	Stage->setScene(NewScene, Loaded.Made->Base->Ground);
	if (Pending.IsSet())
	{
		Stage->setShowsCoarse(Scene.bShowsCoarse);
		(void)Stage->land(Pending->Position, Pending->RadiusM, Pending->Options, NowMs);
		Pending.Reset();
	}
	Scene.OnOpened.Broadcast();
}

void FTerraportSession::Connect(const terraport::SceneUrl& Url, const terraport::Scene& Loaded)
{
	terraport::SessionOptions Options;
	Options.client = "terraport-unreal/0.1.0";
	Options.creditBytes = uint64(std::max(Budgets.CreditMiB, 1)) * Mebibyte;
	Options.cacheBytes = uint64(std::max(Budgets.CacheMiB, 0)) * Mebibyte;
	Options.budgets.maxTriangles = uint64(std::max<int64>(Budgets.MaxTriangles, 1));
	Options.budgets.maxSegments = uint64(std::max(Budgets.MaxSegments, 1));
	Options.budgets.gpuVertexBytes = uint32(FTerraportGroundPiece::VertexBytes);
	Options.budgets.gpuFaceBytes = uint32(3 * FTerraportGroundPiece::CornerBytes);
	// The base, and two landings: one that is shown, and one that replaces it.
	const uint64 Share = GpuShareBytes(Budgets);
	const uint64 Base = Loaded.base.vertexCount * uint64(FTerraportGroundPiece::VertexBytes) +
		Loaded.base.faceCount * uint64(6 * FTerraportGroundPiece::CornerBytes) + Loaded.base.image.gpuBytes();
	Options.budgets.maxGpuBytes = Share > Base ? (Share - Base) / 2 : 0;
	const uint64 DiskBytes = uint64(std::max(Budgets.DiskMiB, 0)) * Mebibyte;
	Disk = std::make_shared<terraport::DiskCache>(DiskFolder(), Url.http(), DiskBytes);
	Decodes = std::make_unique<FTerraportDecodes>(Disk, Materials.Coding, std::max(Scene.DecodeTasks, 1));
	Core = std::make_unique<terraport::Session>(std::move(Options), Disk->list());
	Stage = std::make_unique<terraport::Stage>(*Core, *Decodes, *Renderer);
	terraport::TransportFactory Factory = [](const std::string& Address, const std::string& Subprotocol,
											  const std::string& Shown) -> std::unique_ptr<terraport::Transport> {
		return std::make_unique<FTerraportWebSocket>(Address, Subprotocol, Shown);
	};
	Link = std::make_unique<terraport::Link>(terraport::Link::Context{*Core, std::move(Factory), Url,
		[this]() { return PresentToken(); }, [this](terraport::Event& Event) { Inbox.emplace_back(std::move(Event)); },
		[this](const terraport::LinkState& State) { Inbox.emplace_back(State); }});
}

// ---- events

void FTerraportSession::Handle(FNews& News, double NowMs)
{
	if (const auto* State = std::get_if<terraport::LinkState>(&News))
	{
		ReportLink(*State);
		return;
	}
	const terraport::Event& Event = std::get<terraport::Event>(News);
	Stage->handle(Event, NowMs);
	if (const auto* Opened = std::get_if<terraport::Opened>(&Event))
	{
		Version = Opened->scene.version;
		if (Opened->versionChanged)
		{
			// The same landing becomes presentable once more.
			ReportedPresentable = -1;
			bReportedInFull = false;
		}
		// Once for each connection that needs it: a scene that is damaged is not asked for again with every segment.
		if (Stage->needsScene() && !Loading)
		{
			LoadAttempt = 0;
			StartLoading();
		}
	}
	else if (const auto* Group = std::get_if<terraport::GroupEvent>(&Event))
	{
		GroupEvents.push_back(*Group);
	}
	Report(Event);
}

void FTerraportSession::Report(const terraport::Event& Event)
{
	if (const auto* Planned = std::get_if<terraport::Planned>(&Event))
	{
		FTerraportPlan Plan;
		Plan.Landing = Planned->landing;
		Plan.RadiusM = Planned->place.radiusM;
		Plan.EffectiveRadiusM = std::min(Planned->plan.effectiveRadiusM, Planned->place.radiusM);
		Plan.CoarseRadiusM = Planned->place.coarseRadiusM ? Planned->plan.effectiveRadiusM : 0.0;
		for (const terraport::SegmentRow& Row : Planned->plan.show)
		{
			(Row.follows ? Plan.LoadSegments : Plan.KeptSegments) += 1;
			Plan.LoadBytes += Row.follows ? int64(Row.bytes) : 0;
			Plan.Triangles += int64(Row.faces);
		}
		Plan.OmittedSegments = int32(Planned->plan.omitted);
		Scene.OnPlan.Broadcast(Plan);
	}
	else if (const auto* Complete = std::get_if<terraport::Complete>(&Event))
	{
		FTerraportReady Ready;
		Ready.Landing = Complete->landing;
		Ready.Segments = int32(Complete->rows.size());
		Ready.Missing = int32(Complete->missing);
		Ready.ElapsedMs = std::max(Stage->status().readyMs, 0.0);
		Ready.PayloadBytes = int64(Complete->payloadBytes);
		Scene.OnReady.Broadcast(Ready);
	}
	else if (const auto* Inner = std::get_if<terraport::InnerComplete>(&Event))
	{
		Scene.OnDegraded.Broadcast(Inner->landing);
	}
	else if (const auto* Refused = std::get_if<terraport::Refused>(&Event))
	{
		// What ends a connection is reported by the link's news that follow, which also say whether it is for good.
		if (!Refused->isFatal)
		{
			ReportFailure(Refused->code, Refused->message, Refused->landing, false);
		}
	}
	else if (const auto* PickRefused = std::get_if<terraport::PickRefused>(&Event))
	{
		ReportFailure(PickRefused->code, PickRefused->message, 0, false);
	}
	else if (const auto* Picked = std::get_if<terraport::Picked>(&Event))
	{
		FTerraportPick Pick;
		Pick.Request = int64(Picked->request);
		Pick.bHit = Picked->hit.has_value();
		if (Picked->hit)
		{
			Pick.Location = TerraportPlaces::WorldOf(Scene, Picked->hit->position);
			Pick.Normal = TerraportPlaces::WorldDirectionOf(Scene, Picked->hit->normal);
			Pick.Segment = int32(Picked->hit->segment);
			Pick.Region = int32(Picked->hit->region);
			Pick.Label = TerraportText::FromUtf8(Picked->hit->label);
			Pick.HeightM = Picked->hit->heightM;
			for (const auto& Entry : Picked->hit->attributes)
			{
				Pick.Attributes.Add(TerraportText::FromUtf8(Entry.first), Entry.second);
			}
		}
		Scene.OnPicked.Broadcast(Pick);
	}
	else if (const auto* Notice = std::get_if<terraport::Notice>(&Event))
	{
		UE_LOG(LogTerraport, Log, TEXT("notice of the server: %s"), *TerraportText::FromUtf8(Notice->kind));
	}
}

void FTerraportSession::ReportLink(const terraport::LinkState& State)
{
	FTerraportLink News;
	News.State = ETerraportLink(State.phase);
	News.Attempt = int32(State.attempt);
	News.RetryInS = State.retryInMs / 1000.0;
	News.CloseCode = State.closeCode;
	News.Code = TerraportText::FromUtf8(State.code);
	News.Message = TerraportText::FromUtf8(State.message);
	Scene.OnLink.Broadcast(News);
	if (!bEnded && State.phase == terraport::LinkState::Phase::Closed)
	{
		ReportFailure(State.code, State.message, 0, true);
	}
}

/** What update and show have changed. */
void FTerraportSession::ReportDrawn()
{
	if (bEnded || !Stage)
	{
		return;
	}
	for (const terraport::Swap& Change : Stage->takeSwaps())
	{
		FTerraportSwap Swap;
		Swap.Landing = Change.landing;
		Swap.bDegraded = Change.isInner;
		Swap.Shown = int32(Change.shown.size());
		Swap.Hidden = int32(Change.hidden.size());
		Scene.OnShown.Broadcast(Swap);
		if (bEnded)
		{
			return;
		}
	}
	const terraport::LandingStatus Status = Stage->status();
	const bool bInFull = Status.phase == terraport::LandingPhase::Presentable;
	if (!Scene.bAutoShow && Stage->isPresentable() && (Status.landing != ReportedPresentable || (bInFull && !bReportedInFull)))
	{
		ReportedPresentable = Status.landing;
		bReportedInFull = bInFull;
		Scene.OnPresentable.Broadcast(Status.landing);
	}
	if (!bEnded && Renderer->TakeUnread() && !bReportedUnread)
	{
		bReportedUnread = true;
		ReportFailure("unread_image",
			"images could not be read, expected image/jpeg, image/png or image/ktx2 (ETC1S): such ground is drawn in its "
			"regions' mean colours; build the scene with JPEG textures or vertex colours (docs/how-to/unreal.md)",
			0, false);
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
	Scene.OnFailed.Broadcast(Failure);
}
