// The scene actor itself, on an engine of stubs, against a live service: lands, supersedes, teleports, closes, and looks at
// what would be drawn after each.
//
//   terraport-scene-on-stubs URL RADIUS_M [TOKEN [early|late [BUFFER_BYTES]]]
//
// With "late" something else has loaded the engine's WebSockets module before the plugin starts. A round of the module's thread
// takes BUFFER_BYTES at most (32 KiB). Prints one line of JSON, and ends with 0 where everything was as it must be.
#include "TerraportGroupComponent.h"
#include "TerraportScene.h"
#include "TerraportUserComponent.h"
#include "engine_network.h"

#include "Camera/CameraComponent.h"
#include "Engine/World.h"
#include "Misc/ConfigCacheIni.h"
#include "Modules/ModuleManager.h"
#include "PrimitiveSceneProxy.h"
#include "ProceduralMeshComponent.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <memory>
#include <string>
#include <thread>

IModuleInterface& StubModuleTerraport();

namespace
{
int Faults = 0;

/// As the engine comes: by its own BaseEngine.ini.
void StartEngine(bool bIsLate, unsigned BufferBytes)
{
	EngineNetwork::Install(BufferBytes);
	GConfig->SetDouble(TEXT("WebSockets.LibWebSockets"), TEXT("ThreadTargetFrameTimeInSeconds"), 0.0333, GEngineIni);
	if (bIsLate)
	{
		FModuleManager::Get().LoadModule(TEXT("WebSockets"));
	}
	StubModuleTerraport().StartupModule();
}

void Expect(bool bHolds, const char* Rule)
{
	if (!bHolds)
	{
		std::printf("not as it must be: %s\n", Rule);
		++Faults;
	}
}

struct FDrawn
{
	int64 Triangles = 0;
	int Pieces = 0;
	int Components = 0;
	int Alive = 0;
};

TArray<const FSceneView*> OneView()
{
	static const FSceneView Everything;
	TArray<const FSceneView*> Views;
	Views.Add(&Everything);
	return Views;
}

/// What the render thread would draw, of every component that is there.
FDrawn Drawn()
{
	FDrawn All;
	const TArray<const FSceneView*> Views = OneView();
	for (UPrimitiveComponent* Component : UPrimitiveComponent::StubAll)
	{
		if (!IsValid(Component) || !Component->bStubRegistered)
		{
			continue;
		}
		++All.Alive;
		FMeshElementCollector Collector;
		const std::unique_ptr<FPrimitiveSceneProxy> Proxy(Component->CreateSceneProxy());
		if (Proxy)
		{
			Proxy->GetDynamicMeshElements(Views, FSceneViewFamily(), 1, Collector);
		}
		All.Components += Collector.StubMeshes.empty() ? 0 : 1;
		for (const auto& Mesh : Collector.StubMeshes)
		{
			++All.Pieces;
			All.Triangles += Mesh.second->Elements[0].NumPrimitives;
		}
	}
	return All;
}

class FVisit
{
public:
	FVisit(const std::string& Url, const std::string& Token)
	{
		Scene.SceneUrl = FString(UTF8_TO_TCHAR(Url.c_str()));
		Scene.Token = FString(UTF8_TO_TCHAR(Token.c_str()));
		Scene.OnShown.AddLambda([this](const FTerraportSwap& Swap) {
			LastShown = Swap.Landing;
			++Swaps;
		});
		Scene.OnReady.AddLambda([this](const FTerraportReady& Ready) { LastReady = Ready.Landing; });
		Scene.OnFailed.AddLambda([](const FTerraportFailure& Failure) {
			std::printf("failed: %s: %s\n", TCHAR_TO_UTF8(*Failure.Code), TCHAR_TO_UTF8(*Failure.Message));
		});
		World.StubActor = &Scene;
		User.StubWorld = &World;
		User.StubOwner = &Pawn;
		Group.StubWorld = &World;
		Camera.SetRelativeLocation(FVector(30.0, 40.0, 170.0));
		Pawn.StubFound = &Camera;
		Scene.BeginPlay();
	}

	/// Frames until it holds; false after half a minute in which the socket brought nothing.
	bool Until(const std::function<bool()>& Holds)
	{
		for (int Still = 0; Still < 6000; ++Still)
		{
			if (Holds())
			{
				return true;
			}
			++GFrameCounter;
			const bool bBusy = EngineNetwork::Pump();
			Scene.Tick(0.005f);
			User.TickComponent(0.005f, LEVELTICK_All, nullptr);
			Group.TickComponent(0.005f, LEVELTICK_All, nullptr);
			if (bBusy)
			{
				Still = 0;
				continue;
			}
			std::this_thread::sleep_for(std::chrono::milliseconds(5));
		}
		return false;
	}

	ATerraportScene Scene;
	UTerraportUserComponent User;
	UTerraportGroupComponent Group;
	AActor Pawn;
	UCameraComponent Camera;
	UWorld World;
	int64 LastReady = -1;
	int64 LastShown = -1;
	int Swaps = 0;
};

/// The coarser level in a ring around full detail: there by itself, and gone with a switch. How far each reached, metres.
struct FRings
{
	double ByItself = -1.0;
	double SwitchedOff = -1.0;
};

FRings ExpectRing(FVisit& Visit, const FVector& Place, double RadiusM)
{
	FRings Rings;
	FTerraportPlan Plan;
	Visit.Scene.OnPlan.AddLambda([&Plan](const FTerraportPlan& New) { Plan = New; });
	const auto Land = [&] {
		const int64 Landing = Visit.Scene.Land(Place, RadiusM, FTerraportLandOptions());
		Expect(Visit.Until([&] { return Visit.LastShown == Landing; }), "a landing with or without a ring is shown");
		Expect(Plan.EffectiveRadiusM == RadiusM, "full detail reaches to the radius");
		return Plan.CoarseRadiusM;
	};
	Rings.ByItself = Land();
	const FVector Beyond = Place + FVector(200.0 * RadiusM, 0.0, 1.0e5);
	FTerraportGroundHit Ground;
	const bool bHasRing = Rings.ByItself > 0.0;
	Expect(!bHasRing || (Visit.Scene.GroundAt(Beyond, Ground) && Ground.Segment >= 0), "ground in the ring tells its segment");
	const FDrawn With = Drawn();
	Visit.Scene.bShowsCoarse = false;
	Rings.SwitchedOff = Land();
	Expect(!bHasRing || (Visit.Scene.GroundAt(Beyond, Ground) && Ground.Segment < 0), "without a ring it is the base");
	Expect((Drawn().Pieces < With.Pieces) == bHasRing, "fewer pieces are drawn");
	Visit.Scene.bShowsCoarse = true;
	Visit.Scene.OnPlan.Clear();
	return Rings;
}

/// By the group's component: a seat, a landing of the group that is followed, and its barrier opens; then one that is not.
void ExpectTogether(FVisit& Visit, const FVector& Place, double RadiusM)
{
	FTerraportGroup Called, Gathered;
	Visit.Group.OnCalled.AddLambda([&Called](const FTerraportGroup& Group) { Called = Group; });
	Visit.Group.OnGathered.AddLambda([&Gathered](const FTerraportGroup& Group) { Gathered = Group; });
	Visit.Group.OnRefused.AddLambda([](const FString&) { Expect(false, "nothing of the group is refused"); });
	Expect(!Visit.Group.Join(TEXT("a tour"), true, TEXT("Ada")), "a name that cannot be is refused at once");
	Expect(Visit.Group.Join(TEXT("tour"), true, TEXT("Ada")), "a seat is asked for");
	Expect(Visit.Until([&Visit] { return Visit.Group.GetGroup().Members.Num() == 1; }), "there is a list of who is there");
	Expect(Visit.Group.GetGroup().bGuide && Visit.Group.GetGroup().Members[0].bPresent, "the guide is there");
	Expect(Visit.Group.Gather(Place, RadiusM), "the group is landed");
	Expect(Visit.Until([&Gathered] { return Gathered.Gathering == 1; }), "everybody is there");
	Expect(Called.Gathering == 1 && Called.Location.Equals(Place, 0.5), "it was told where");
	Expect(Gathered.Ready.Num() == 1 && Gathered.Ready[0] == Gathered.Member, "this one too");
	Visit.Group.bFollow = false;
	const int Swaps = Visit.Swaps;
	Visit.Until([] { return true; });
	Expect(Visit.Group.Gather(Place + FVector(500.0, 0.0, 0.0), RadiusM), "the group is landed elsewhere");
	Visit.Group.TickComponent(0.005f, LEVELTICK_All, nullptr);
	Expect(Visit.Until([&Gathered] { return Gathered.Gathering == 2; }), "nobody is waited for");
	Expect(Gathered.Missing.Num() == 1 && Visit.Swaps == Swaps, "who does not follow stays");
	Visit.Group.EndPlay(EEndPlayReason::Destroyed);
	Expect(Visit.Group.GetGroup().Name.IsEmpty(), "the seat was given up");
}

/// What is drawn is what the stage says, to the triangle.
void ExpectShown(FVisit& Visit, int64 Landing)
{
	Expect(Visit.LastShown == Landing, "the newest landing is the one that is shown");
	Expect(Visit.Scene.GetStatus().Phase == ETerraportLandingPhase::Shown, "its phase is Shown");
	const FTerraportStats Stats = Visit.Scene.TakeStats();
	Expect(Stats.VisibleSegments > 0, "segments are shown");
	Expect(Drawn().Triangles == Stats.VisibleTriangles, "the triangles that are drawn are those of the stage");
}

/// Height of the highest solid face over a location, centimetres; far below where there is none.
double SolidHeight(const FVector& At)
{
	double Highest = -1.0e9;
	for (const UProceduralMeshComponent* Component : UProceduralMeshComponent::StubAll)
	{
		if (!IsValid(Component) || !Component->StubSection.bEnableCollision)
		{
			continue;
		}
		const FProcMeshSection& Section = Component->StubSection;
		for (int32 Face = 0; Face < Section.ProcIndexBuffer.Num() / 3; ++Face)
		{
			const auto Corner = [&Section, Face](int32 Number) {
				return Section.ProcVertexBuffer[int32(Section.ProcIndexBuffer[3 * Face + Number])].Position;
			};
			const FVector A = Corner(0), U = Corner(1) - A, V = Corner(2) - A, T = At - A;
			const double Area = U.X * V.Y - U.Y * V.X;
			const double Beta = (T.X * V.Y - T.Y * V.X) / Area, Gamma = (U.X * T.Y - U.Y * T.X) / Area;
			if (Beta >= -1e-9 && Gamma >= -1e-9 && Beta + Gamma <= 1.0 + 1e-9)
			{
				Highest = std::max(Highest, A.Z + Beta * U.Z + Gamma * V.Z);
			}
		}
	}
	return Highest;
}

/// An aim meets ground, unless something of the asked types stands before it.
void ExpectObstacles(FVisit& Visit, const FVector& Above)
{
	FTerraportGroundHit Hit;
	const FVector Down(0.01, 0.0, -1.0);
	Visit.World.StubWallX = Above.X + 1.0;
	Visit.World.StubWallType = ObjectTypeQuery2;
	Expect(Visit.User.TryAim(Above, Down, 1.0e6, Hit), "without a mask nothing stops an aim");
	Visit.User.Obstacles.Add(ObjectTypeQuery1);
	Expect(Visit.User.TryAim(Above, Down, 1.0e6, Hit), "what is of another type does not stop it");
	Visit.User.Obstacles.Add(ObjectTypeQuery2);
	Expect(!Visit.User.TryAim(Above, Down, 1.0e6, Hit), "what is of that type does");
	Visit.World.StubWallOf = &Visit.Scene;
	Expect(Visit.User.TryAim(Above, Down, 1.0e6, Hit), "the scene's own bodies are ground");
	Visit.User.Obstacles.Reset();
}

/// In the editor: base and landing below the viewport's camera, anew when it has moved, and gone when it is switched off.
void ExpectPreview(FVisit& Visit, const FVector& Middle)
{
	Visit.World.WorldType = EWorldType::Editor;
	Visit.Scene.StubWorld = &Visit.World;
	Visit.Scene.Close();
	Visit.World.ViewLocationsRenderedLastFrame.Add(Middle + FVector(0.0, 0.0, 5.0e4));
	Visit.Scene.Tick(0.005f);
	Expect(!Visit.Scene.ShouldTickIfViewportsOnly() && Drawn().Alive == 0, "without the switch there is no preview");
	Visit.Scene.bPreviewInEditor = true;
	Visit.Scene.PreviewRadiusM = 15.0;
	const int SwapsBefore = Visit.Swaps;
	Expect(Visit.Scene.ShouldTickIfViewportsOnly(), "it ticks without play");
	Expect(Visit.Until([&] { return Visit.Swaps > SwapsBefore && Visit.Scene.TakeStats().VisibleSegments > 0; }),
		"the preview lands below the camera");
	const int64 Landing = Visit.Scene.GetStatus().Landing;
	Visit.World.ViewLocationsRenderedLastFrame[0] += FVector(100.0, 0.0, 0.0);
	Visit.Scene.Tick(0.005f);
	Expect(Visit.Scene.GetStatus().Landing == Landing, "a metre aside nothing is asked for");
	Visit.World.ViewLocationsRenderedLastFrame[0] += FVector(900.0, 0.0, 0.0);
	Visit.Scene.Tick(0.005f);
	Expect(Visit.Scene.GetStatus().Landing == Landing + 1, "farther away it lands anew");
	Visit.Scene.bPreviewInEditor = false;
	FPropertyChangedEvent Event;
	Visit.Scene.PostEditChangeProperty(Event);
	Visit.Scene.Tick(0.005f);
	Expect(Drawn().Alive == 0 && FRenderResource::StubGpuBytes == 0, "switched off, nothing of it is left");
}

/// Bodies stand where feet do: the ground is solid around them, wherever they have walked.
void ExpectSolid(FVisit& Visit)
{
	Visit.Scene.FeetOf = &Visit.Pawn;
	for (int Step = 0; Step < 10; ++Step)
	{
		FTerraportGroundHit Ground;
		const FVector Next = Visit.Pawn.GetActorLocation() + FVector(130.0, 40.0, 0.0);
		if (!Visit.Scene.GroundAt(Next + FVector(0.0, 0.0, 100.0), Ground))
		{
			continue; // Beyond the scene.
		}
		Visit.Pawn.SetActorLocation(Ground.Location, false, nullptr, ETeleportType::TeleportPhysics);
		Visit.Scene.Tick(0.011f);
		Expect(std::abs(SolidHeight(Ground.Location) - Ground.Location.Z) < 2.0, "solid ground is where it is shown");
	}
	Visit.Scene.FeetOf = nullptr;
}
} // namespace

int main(int Count, char** Arguments)
{
	if (Count < 3)
	{
		std::printf("usage: %s URL RADIUS_M [TOKEN [early|late [BUFFER_BYTES]]]\n", Arguments[0]);
		return 2;
	}
	// 1. Engine, actor and user; the scene opens.
	const double RadiusM = std::atof(Arguments[2]);
	const unsigned BufferBytes = Count > 5 ? unsigned(std::atoi(Arguments[5])) : 32 * 1024;
	StartEngine(Count > 4 && std::string(Arguments[4]) == "late", BufferBytes);
	const std::size_t Warnings = StubWarnings.size();
	FVisit Visit(Arguments[1], Count > 3 ? Arguments[3] : "");
	Visit.User.RadiusM = RadiusM;
	Visit.User.FadeS = 0.01f;
	if (!Visit.Until([&Visit] { return Visit.Scene.IsOpen(); }))
	{
		std::printf("the scene did not open\n");
		return 1;
	}
	const FBox Bounds = Visit.Scene.GetSceneBounds();
	const FVector Middle = (Bounds.Min + Bounds.Max) * 0.5;
	const FVector Corner = Bounds.Min * 0.7 + Bounds.Max * 0.3;

	// 2. The first landing, with the pace of the module's thread meanwhile.
	EngineNetwork::Await(200);
	const EngineNetwork::FPace Before = EngineNetwork::Pace();
	int64 First = Visit.Scene.Land(Middle, RadiusM, FTerraportLandOptions());
	Expect(Visit.Until([&] { return Visit.LastReady == First; }), "the first landing is ready");
	const EngineNetwork::FPace After = EngineNetwork::Pace();
	EngineNetwork::Await(1);
	Expect(Visit.Until([&] { return Visit.LastShown == First; }), "the first landing is shown");
	const int64 FirstBytes = Visit.Scene.TakeStats().PayloadBytes;
	ExpectShown(Visit, First);
	const FDrawn AtFirst = Drawn();
	const int64 GpuAtFirst = FRenderResource::StubGpuBytes;

	// 3. Two at once: the newer one counts, and the older one is never shown.
	Visit.Scene.Land(Corner, RadiusM, FTerraportLandOptions());
	const int64 Second = Visit.Scene.Land(Bounds.Min * 0.4 + Bounds.Max * 0.6, RadiusM, FTerraportLandOptions());
	Expect(Visit.Until([&] { return Visit.LastShown == Second; }), "the newer of two landings is shown");
	ExpectShown(Visit, Second);
	Expect(Visit.Swaps == 2, "the landing that was superseded was not");

	// 4. Back; what lies just beyond the radius may stay now, so it need not be the very same set.
	const int64 Third = Visit.Scene.Land(Middle, RadiusM, FTerraportLandOptions());
	Expect(Visit.Until([&] { return Visit.LastShown == Third; }), "a landing where one was before is shown");
	ExpectShown(Visit, Third);

	// 5. Ground, and a teleport onto it.
	FTerraportGroundHit Ground;
	Expect(Visit.Scene.GroundAt(Middle + FVector(0.0, 0.0, 1.0e6), Ground), "there is ground in the middle");

	Expect(Visit.User.TeleportTo(Corner), "a teleport begins");
	Expect(!Visit.Scene.bAutoShow, "the swap waits for the dark");
	Expect(Visit.Until([&Visit] { return !Visit.User.IsTeleporting(); }), "it ends");
	Expect(Visit.Scene.bAutoShow, "the scene shows by itself again");
	ExpectShown(Visit, Visit.Scene.GetStatus().Landing);
	const FVector Head = Visit.Pawn.GetActorLocation() + FVector(30.0, 40.0, 0.0);
	Expect(Head.Equals(FVector(Corner.X, Corner.Y, Head.Z), 0.5), "the head is above the place");
	Expect(Visit.Scene.GroundAt(Head + FVector(0.0, 0.0, 100.0), Ground) && Ground.Location.Equals(Head, 1.0),
		"the feet are on the ground");

	ExpectSolid(Visit);
	ExpectObstacles(Visit, Middle + FVector(0.0, 0.0, 1.0e5));
	FTerraportPlace Place;
	Expect(!Visit.Scene.FindPlace(TEXT("no such place"), Place) && !Visit.User.TeleportToPlace(TEXT("no such place")),
		"a name that nobody gave is no place");
	for (const FTerraportPlace& Each : Visit.Scene.GetPlaces())
	{
		Expect(Visit.Scene.FindPlace(Each.Label, Place) && Place.RadiusM > 0.0, "each place is found by its name");
	}

	ExpectTogether(Visit, Middle, RadiusM);
	const FRings Rings = ExpectRing(Visit, Middle, RadiusM);

	// 6. The survey's reference system.
	FVector Survey, Back;
	Expect(Visit.Scene.WorldToSurvey(Head, Survey) && Visit.Scene.SurveyToWorld(Survey, Back) && Back.Equals(Head, 0.01),
		"places go to the survey's frame and back");

	// 7. The end.
	const FDrawn Last = Drawn();
	const FTerraportStats Stats = Visit.Scene.TakeStats();
	Visit.Scene.EndPlay(EEndPlayReason::Destroyed);
	Expect(Drawn().Alive == 0, "closing leaves no component");
	Expect(FRenderResource::StubGpuBytes == 0, "closing leaves nothing on the graphics");
	ExpectPreview(Visit, Middle);
	// Decodes that were under way end by themselves.
	std::this_thread::sleep_for(std::chrono::milliseconds(300));
	std::printf("{\"faults\": %d, \"swaps\": %d, \"first\": {\"triangles\": %lld, \"pieces\": %d, \"components\": %d, "
				"\"gpu_bytes\": %lld}, "
				"\"ring_m\": %g, \"ring_off_m\": %g, "
				"\"last\": {\"triangles\": %lld, \"pieces\": %d, \"components\": %d}, \"made\": %zu, \"payload_bytes\": %lld, "
				"\"socket\": {\"frame_time_s\": %g, \"frames\": %d, "
				"\"rounds\": %d, \"payload_bytes\": %lld, \"warnings\": %zu}}\n",
		Faults, Visit.Swaps, AtFirst.Triangles, AtFirst.Pieces, AtFirst.Components, GpuAtFirst, Rings.ByItself,
		Rings.SwitchedOff, Last.Triangles, Last.Pieces, Last.Components, UPrimitiveComponent::StubAll.size(),
		Stats.PayloadBytes, After.FrameTimeS, After.Frames - Before.Frames, After.Rounds - Before.Rounds, FirstBytes, Warnings);
	return Faults == 0 ? 0 : 1;
}
