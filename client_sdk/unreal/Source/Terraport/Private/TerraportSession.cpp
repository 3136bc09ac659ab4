#include "TerraportSession.h"

#include "GameFramework/Actor.h"
#include "HAL/FileManager.h"
#include "HAL/PlatformMemory.h"
#include "HAL/PlatformTime.h"
#include "Materials/MaterialInterface.h"
#include "Misc/Paths.h"
#include "Modules/ModuleManager.h"
#include "TerraportLog.h"
#include "TerraportText.h"
#include "TerraportWebSocket.h"

#include <algorithm>
#include <utility>

namespace
{
/** Faces of the base that one swap rebuilds at least: about half a millisecond to make a component of. */
constexpr uint32 BaseBlockFaces = 2048;
/** Bytes of the network that one frame takes in: copied and hashed in a few tenths of a millisecond; 37 MB/s at 72 Hz. */
constexpr std::size_t MaxPumpBytes = 512 * 1024;
/** Waits between attempts to load the base, seconds: doubled each time. */
constexpr double FirstRetryS = 1.0;
constexpr double MaxRetryS = 30.0;
constexpr uint64 Mebibyte = 1024 * 1024;
/** Of the share of the graphics, for segments that an aim brings ahead. */
constexpr uint64 SparePart = 8;

double NowMilliseconds()
{
	return FPlatformTime::Seconds() * 1000.0;
}

/** Nothing that a second attempt could change. */
bool IsFinal(const std::string& Code)
{
	return Code != "unreachable" && Code != "draining" && Code != "too_many" && Code != "server_full";
}
} // namespace

FTerraportSession::FTerraportSession(AActor& InOwner, std::unique_ptr<ITerraportSessionHost> InHost,
	const FTerraportSessionSettings& Settings, TSet<TObjectPtr<UObject>>& ReferencedObjects,
	TSharedRef<ITerraportMeshBackend, ESPMode::ThreadSafe> InBackend)
	: Owner(InOwner), Host(std::move(InHost)), Keeper(ReferencedObjects), Backend(InBackend), Token(Settings.Token),
	  TokenProvider(Settings.TokenProvider), Budgets(Settings.Budgets), Colours(Settings.VertexColours)
{
	// Worker threads may only look it up.
	FModuleManager::Get().LoadModule(TEXT("ImageWrapper"));
	const FTerraportMaterials Materials = MaterialsOf(Settings.Materials, Settings.bLit);
	// The actor's properties may name others while this session draws with these.
	for (UMaterialInterface* Material : {Materials.Colour, Materials.Texture, Materials.BaseColour, Materials.BaseTexture})
	{
		KeptMaterials.push_back(Material);
		Keeper.Keep(Material);
	}
	Renderer = std::make_unique<FTerraportRenderer>(Owner, Keeper, Backend, Materials, Settings.Mesh);
	Ground = std::make_unique<terraport::ShownGround>(*Renderer, [](const terraport::SegmentMesh& Mesh) {
		FTerraportSegmentData* Data = static_cast<FTerraportSegmentData*>(Mesh.engineData.get());
		return Data != nullptr ? std::move(Data->Ground) : terraport::SharedGround();
	});
	Decodes = std::make_unique<FTerraportDecodes>(Backend, Colours, std::max(Settings.DecodeTasks, 1));
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
	if (Stream)
	{
		Stream->close();
	}
	Loading.reset();
	Follower.reset();
	Stage.reset();
	Stream.reset();
	Decodes.reset();
	Feet.reset();
	Ground.reset();
	Renderer.reset();
	for (UMaterialInterface* Material : KeptMaterials)
	{
		Keeper.Release(Material);
	}
	KeptMaterials.clear();
	Swaps.clear();
}

void FTerraportSession::Tick()
{
	const double StartMs = NowMilliseconds();
	const double EndMs = StartMs + Host->GetFrameBudgetMs();
	PollLoading(StartMs);
	if (bEnded)
	{
		return;
	}
	if (Stream)
	{
		Stream->pump(StartMs);
		terraport::StreamEvent Event;
		while (!bEnded && Stream->tryNextEvent(Event))
		{
			if (Event.kind == terraport::EventKind::Opened)
			{
				StreamVersion = Event.sceneVersion;
				// Published anew between the files and the connection.
				Event.changed = Event.changed || StreamVersion != Stage->files().manifest.version;
			}
			Stage->handle(Event);
			NoteGroup(Event);
			// Once for each connection that needs them: files that are damaged are not asked for again with every segment.
			if (Event.kind == terraport::EventKind::Opened && Stage->needsFiles() && !Loading)
			{
				LoadAttempt = 0;
				StartLoading();
			}
			Report(Event);
		}
	}
	if (!bEnded)
	{
		Draw(StartMs, EndMs);
	}
}

void FTerraportSession::Draw(double StartMs, double EndMs)
{
	if (Stage)
	{
		Stage->setAutoShow(Host->IsAutoShow());
		Stage->setShowsCoarse(Host->ShowsCoarse());
		Stage->update([]() { return NowMilliseconds(); }, std::max(EndMs - NowMilliseconds(), 0.0));
		Follower->update();
	}
	Renderer->Step(EndMs / 1000.0);
	MaxFrameMs = std::max(MaxFrameMs, NowMilliseconds() - StartMs);
	ReportSwaps();
	if (!bEnded)
	{
		ReportPresentable();
	}
	if (!bEnded)
	{
		ReportUnread();
	}
}

int64 FTerraportSession::Land(const terraport::Vec3& Position, double RadiusM, const terraport::LandOptions& Options)
{
	if (!Stage)
	{
		FPending Newest;
		Newest.Position = Position;
		Newest.RadiusM = RadiusM;
		Newest.Options = Options;
		Pending = Newest;
		return 0;
	}
	// Now, and not with the next frame: it may have been switched just before.
	Stage->setShowsCoarse(Host->ShowsCoarse());
	return Stage->land(Position, RadiusM, Options, NowMilliseconds());
}

void FTerraportSession::Aim(const terraport::Vec3& Position, double RadiusM)
{
	if (Stage)
	{
		Stage->setShowsCoarse(Host->ShowsCoarse());
		Stage->aim(Position, RadiusM);
	}
}

int64 FTerraportSession::Pick(const terraport::Vec3& Origin, const terraport::Vec3& Direction)
{
	if (!Stream)
	{
		return -1;
	}
	const terraport::Result<std::uint64_t> Request = Stream->pick(Origin, Direction);
	return Request.isOk() ? int64(Request.value()) : -1;
}

void FTerraportSession::StepFeet(const terraport::Vec3& Place, double HalfM, int32 MaxFaces)
{
	if (bEnded || !Stage)
	{
		return;
	}
	if (!Feet)
	{
		Feet = std::make_unique<FTerraportFeet>(Owner, Keeper);
	}
	Feet->Step(*Ground, Place, HalfM, MaxFaces);
}

bool FTerraportSession::Show()
{
	const bool bShown = Stage && Stage->show();
	ReportSwaps();
	return bShown;
}

void FTerraportSession::Reconnect(const std::string& NewToken)
{
	if (!NewToken.empty())
	{
		Token = NewToken;
		TokenProvider = nullptr;
	}
	if (Stream)
	{
		Stream->reconnect(NewToken);
	}
	if ((!Stage || Stage->needsFiles()) && !Loading)
	{
		LoadAttempt = 0;
		StartLoading();
	}
}

FTerraportStats FTerraportSession::TakeStats()
{
	FTerraportStats Stats;
	if (Stream)
	{
		const terraport::StreamStats StreamStats = Stream->stats();
		Stats.PayloadBytes = int64(StreamStats.payloadBytes);
		Stats.HeldBytes = int64(StreamStats.heldBytes);
	}
	if (Stage)
	{
		const terraport::StageStats StageStats = Stage->stats();
		Stats.Segments = int32(StageStats.segments);
		Stats.VisibleSegments = int32(StageStats.visibleSegments);
		Stats.VisibleTriangles = int64(StageStats.visibleTriangles);
		Stats.GpuBytes = int64(StageStats.gpuBytes);
	}
	Stats.MaxFrameMs = MaxFrameMs;
	MaxFrameMs = 0.0;
	return Stats;
}

void FTerraportSession::StartLoading()
{
	FTerraportFilesRequest Request;
	Request.Url = TerraportText::ToUtf8(Host->GetSceneUrl());
	Request.Token = TokenProvider ? TokenProvider() : Token;
	Request.Version = StreamVersion;
	Request.BlockFaces = BaseBlockFaces;
	Request.Colours = Colours;
	RetryAtMs = 0.0;
	++LoadAttempt;
	Loading = std::make_unique<FTerraportFiles>(Request);
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
	FTerraportFilesResult Result;
	if (!Loading->Poll(Result))
	{
		return;
	}
	Loading.reset();
	if (Result.Status.isOk())
	{
		if (Stage && Result.Files->manifest.version != StreamVersion)
		{
			// The connection went on to another version meanwhile. Ids in the cover belong to one: with another one's base
			// there would be holes.
			RetryLater(NowMs);
			return;
		}
		LoadAttempt = 0;
		TakeFiles(Result, NowMs);
		return;
	}
	// A version that the server has given up since: the next connection names a newer one, whose files are then asked for.
	const bool bGone = !StreamVersion.empty() && Result.Status.code().compare(0, 7, "unknown") == 0;
	const bool bFinal = IsFinal(Result.Status.code()) && !bGone;
	if (!bFinal)
	{
		RetryLater(NowMs);
	}
	ReportFailure(Result.Status.code(), Result.Status.text(), 0, bFinal);
}

void FTerraportSession::RetryLater(double NowMs)
{
	const double WaitS = std::min(FirstRetryS * double(1 << std::min(std::max(LoadAttempt - 1, 0), 10)), MaxRetryS);
	RetryAtMs = NowMs + 1000.0 * WaitS;
}

void FTerraportSession::TakeFiles(FTerraportFilesResult& Result, double NowMs)
{
	Renderer->SetBase(Result.Base.ToSharedRef());
	Ground->setBase(Result.Base->Ground);
	if (Stage)
	{
		Stage->replaceFiles(Result.Files);
		Host->OnOpened();
		return;
	}
	if (!MakeStream(Result))
	{
		return;
	}
	terraport::StageOptions Options;
	Options.spareGpuBytes = std::size_t(GpuShareBytes() / SparePart);
	Options.baseBlockFaces = BaseBlockFaces;
	Options.autoShow = Host->IsAutoShow();
	Options.showsCoarse = Host->ShowsCoarse();
	Stage = std::make_unique<terraport::SceneStage>(*Stream, Result.Files, *Ground, *Decodes, Options);
	Stage->onSwap([this](const terraport::SceneSwap& Change) { Swaps.push_back(Change); });
	Follower = std::make_unique<terraport::GroupFollower>(*Stream, *Stage);
	// Before a component of groups has said so, nobody is taken anywhere.
	Follower->setFollows(false);
	if (Pending.IsSet())
	{
		Stage->land(Pending->Position, Pending->RadiusM, Pending->Options, NowMs);
		Pending.Reset();
	}
	Host->OnOpened();
}

bool FTerraportSession::MakeStream(const FTerraportFilesResult& Files)
{
	terraport::Result<std::unique_ptr<terraport::SceneStream>> NewStream =
		terraport::SceneStream::make(StreamOptionsOf(Files), std::make_shared<FTerraportWebSockets>());
	if (!NewStream.isOk())
	{
		ReportFailure(NewStream.status().code(), NewStream.status().text(), 0, true);
		return false;
	}
	Stream = NewStream.take();
	Stream->setMaxPumpBytes(MaxPumpBytes);
	return true;
}

/** What is stated, or an eighth of the device's memory: what a mesh keeps beside the graphics' copy lies there, too. */
uint64 FTerraportSession::GpuShareBytes() const
{
	const uint64 Stated = uint64(std::max(Budgets.MaxGpuMebibytes, 1)) * Mebibyte;
	const uint64 Device = FPlatformMemory::GetConstants().TotalPhysical / 8;
	return Device > 0 ? std::min(Stated, Device) : Stated;
}

terraport::StreamOptions FTerraportSession::StreamOptionsOf(const FTerraportFilesResult& Files) const
{
	terraport::StreamOptions Options;
	Options.sceneUrl = Files.SceneUrl;
	Options.token = Token;
	Options.tokenProvider = TokenProvider;
	Options.budgets.maxTriangles = uint64(std::max<int64>(Budgets.MaxTriangles, 1));
	// The base, an eighth for what an aim brings, and two landings: one that is shown, and one that replaces it.
	const uint64 Share = GpuShareBytes();
	const uint64 Taken = Share / SparePart + Renderer->gpuBytesOf(Files.Files->base);
	Options.budgets.maxGpuBytes = Share > Taken ? (Share - Taken) / 2 : 0;
	Options.budgets.gpuVertexBytes = uint32(Backend->BytesOf(1, 0));
	Options.budgets.gpuFaceBytes = uint32(Backend->BytesOf(0, 3));
	Options.budgets.maxSegments = uint64(std::max(Budgets.MaxSegments, 1));
	Options.cacheBytes = uint64(std::max(Budgets.CacheMiB, 0)) * Mebibyte;
	// The cache opens files without the engine, so its path must be absolute. FPaths::ConvertRelativePathToFull gives a
	// relative one on Android and iOS; this is what the platform's own file layer writes to.
	const FString Saved = FPaths::ProjectSavedDir() / TEXT("Terraport");
	Options.diskFolder = TerraportText::ToUtf8(IFileManager::Get().ConvertToAbsolutePathForExternalAppForWrite(*Saved));
	Options.diskBytes = uint64(std::max(Budgets.DiskMiB, 0)) * Mebibyte;
	Options.creditBytes = uint64(std::max(Budgets.CreditMiB, 1)) * Mebibyte;
	return Options;
}
