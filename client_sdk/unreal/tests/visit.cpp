#include "visit.h"

#include "engine_network.h"

#include "Core/Stage.h"
#include "Misc/ConfigCacheIni.h"
#include "Modules/ModuleManager.h"
#include "PrimitiveSceneProxy.h"
#include "ProceduralMeshComponent.h"
#include "TerraportSession.h"

#include <algorithm>
#include <chrono>
#include <cstdarg>
#include <cstdio>
#include <memory>
#include <thread>

IModuleInterface& StubModuleTerraport();

namespace {
std::string Format(const char* Pattern, ...) {
  char Text[4096];
  va_list Values;
  va_start(Values, Pattern);
  std::vsnprintf(Text, sizeof(Text), Pattern, Values);
  va_end(Values);
  return Text;
}

std::string TextOf(const FString& Text) {
  std::string Out;
  for (const char Letter : std::string(TCHAR_TO_UTF8(*Text))) Out += Letter == '"' || Letter == '\\' ? '\'' : Letter;
  return Out;
}

std::string ListOf(const std::vector<std::string>& Items) {
  std::string Out;
  for (const std::string& Item : Items) Out += (Out.empty() ? "" : ", ") + Item;
  return "[" + Out + "]";
}

template <typename T>
std::string NumbersOf(const T& Numbers) {
  std::vector<std::string> Items;
  for (const auto& Number : Numbers) Items.push_back(std::to_string(Number));
  return ListOf(Items);
}

/// Segments that are shown, ascending; those of the coarser level count on from the last of the finer.
std::vector<int64> ShownIds(const ATerraportScene& Scene) {
  std::vector<int64> Ids;
  const terraport::Stage* Stage = Scene.GetSession() != nullptr ? Scene.GetSession()->GetStage() : nullptr;
  if (Stage != nullptr) {
    for (const auto& Entry : Stage->visible()) {
      Ids.push_back(int64(Entry.second.id) + (Entry.second.isCoarse ? int64(Stage->scene()->segmentCount) : 0));
    }
  }
  std::sort(Ids.begin(), Ids.end());
  return Ids;
}
} // namespace

FDrawn Drawn() {
  static const FSceneView Everything;
  TArray<const FSceneView*> Views;
  Views.Add(&Everything);
  FDrawn All;
  for (UPrimitiveComponent* Component : UPrimitiveComponent::StubAll) {
    if (!IsValid(Component) || !Component->bStubRegistered) continue;
    ++All.Alive;
    FMeshElementCollector Collector;
    const std::unique_ptr<FPrimitiveSceneProxy> Proxy(Component->CreateSceneProxy());
    if (Proxy) Proxy->GetDynamicMeshElements(Views, FSceneViewFamily(), 1, Collector);
    All.Components += Collector.StubMeshes.empty() ? 0 : 1;
    for (const auto& Mesh : Collector.StubMeshes) {
      ++All.Pieces;
      All.Triangles += Mesh.second->Elements[0].NumPrimitives;
    }
  }
  return All;
}

double SolidHeight(const FVector& At) {
  double Highest = -1.0e9;
  for (const UProceduralMeshComponent* Component : UProceduralMeshComponent::StubAll) {
    if (!IsValid(Component) || !Component->StubSection.bEnableCollision) continue;
    const FProcMeshSection& Section = Component->StubSection;
    for (int32 Face = 0; Face < Section.ProcIndexBuffer.Num() / 3; ++Face) {
      const auto Corner = [&Section, Face](int32 Number) {
        return Section.ProcVertexBuffer[int32(Section.ProcIndexBuffer[3 * Face + Number])].Position;
      };
      const FVector A = Corner(0), U = Corner(1) - A, V = Corner(2) - A, T = At - A;
      const double Area = U.X * V.Y - U.Y * V.X;
      const double Beta = (T.X * V.Y - T.Y * V.X) / Area, Gamma = (U.X * T.Y - U.Y * T.X) / Area;
      if (Beta >= -1e-9 && Gamma >= -1e-9 && Beta + Gamma <= 1.0 + 1e-9) {
        Highest = std::max(Highest, A.Z + Beta * U.Z + Gamma * V.Z);
      }
    }
  }
  return Highest;
}

FVisit::FVisit() {
  Scene.OnOpened.AddLambda([this]() { Events.push_back("\"opened\""); });
  Scene.OnLink.AddLambda([this](const FTerraportLink& Link) {
    bOpen = Link.State == ETerraportLink::Open;
    constexpr const char* States[] = {"connecting", "open", "waiting", "closed"};
    Links.push_back(Format("{\"state\": \"%s\", \"attempt\": %d, \"retry_in_s\": %g, \"code\": \"%s\", \"close_code\": %d}",
        States[int(Link.State)], Link.Attempt, Link.RetryInS, TextOf(Link.Code).c_str(), Link.CloseCode));
  });
  Scene.OnPlan.AddLambda([this](const FTerraportPlan& Plan) {
    LastPlanned = Plan.Landing;
    Plans.push_back(
        Format("{\"landing\": %lld, \"load_segments\": %d, \"kept_segments\": %d, \"load_bytes\": %lld, "
               "\"omitted\": %d, \"effective_radius_m\": %.17g, \"coarse_radius_m\": %.17g}",
            (long long)Plan.Landing, Plan.LoadSegments, Plan.KeptSegments, (long long)Plan.LoadBytes, Plan.OmittedSegments,
            Plan.EffectiveRadiusM, Plan.CoarseRadiusM));
  });
  Scene.OnReady.AddLambda([this](const FTerraportReady& Ready) {
    LastReady = Ready.Landing;
    Events.push_back(Format("\"ready %d %lld\"", Ready.Missing, (long long)Ready.PayloadBytes));
  });
  Scene.OnDegraded.AddLambda([this](int64) { Events.push_back("\"degraded\""); });
  Scene.OnShown.AddLambda([this](const FTerraportSwap& Swap) {
    LastShown = Swap.bDegraded ? LastShown : Swap.Landing;
    ++Swaps;
    Landings.push_back(Format("{\"landing\": %lld, \"degraded\": %s, \"visible\": ", (long long)Swap.Landing,
                           Swap.bDegraded ? "true" : "false") +
        NumbersOf(ShownIds(Scene)) +
        Format(", \"drawn_triangles\": %lld, \"visible_triangles\": %lld}", (long long)Drawn().Triangles,
            (long long)Scene.TakeStats().VisibleTriangles));
  });
  Scene.OnFailed.AddLambda([this](const FTerraportFailure& Failure) {
    Refusal = Failure.bFatal ? TextOf(Failure.Code) : Refusal;
    Failures.push_back(
        Format("{\"code\": \"%s\", \"message\": \"%s\", \"landing\": %lld, \"fatal\": %s}", TextOf(Failure.Code).c_str(),
            TextOf(Failure.Message).c_str(), (long long)Failure.Landing, Failure.bFatal ? "true" : "false"));
  });
  Scene.OnPicked.AddLambda([this](const FTerraportPick& Pick) {
    const double* Grade = Pick.Attributes.Find(FString(TEXT("grade")));
    Picks.push_back(Format("{\"hit\": %s, \"segment\": %d, \"location\": [%.17g, %.17g, %.17g], \"grade\": %g}",
        Pick.bHit ? "true" : "false", Pick.Segment, Pick.Location.X / 100.0, Pick.Location.Z / 100.0, Pick.Location.Y / 100.0,
        Grade != nullptr ? *Grade : -1.0));
  });
  Group.OnRefused.AddLambda([this](const FString& Message) {
    Refusal = "refused";
    Events.push_back("\"group refused: " + TextOf(Message) + "\"");
  });
  Group.OnCalled.AddLambda([this](const FTerraportGroup& Now) {
    Events.push_back(
        Format("\"called %g %g %g %g\"", Now.Location.X / 100.0, Now.Location.Z / 100.0, Now.Location.Y / 100.0, Now.RadiusM));
  });
  Group.OnGathered.AddLambda([this](const FTerraportGroup& Now) {
    Gathered = Now.Gathering;
    Gatherings.push_back("{\"ready\": " + NumbersOf(Now.Ready) + ", \"missing\": " + NumbersOf(Now.Missing) + "}");
  });
  World.StubActor = &Scene;
  User.StubWorld = &World;
  User.StubOwner = &Pawn;
  Group.StubWorld = &World;
  Camera.SetRelativeLocation(FVector(30.0, 40.0, 170.0));
  Pawn.StubFound = &Camera;
}

void FVisit::Start(const std::string& Url, unsigned BufferBytes, bool bLate) {
  EngineNetwork::Install(BufferBytes);
  // As the engine's own BaseEngine.ini has it.
  GConfig->SetDouble(TEXT("WebSockets.LibWebSockets"), TEXT("ThreadTargetFrameTimeInSeconds"), 0.0333, GEngineIni);
  if (bLate) FModuleManager::Get().LoadModule(TEXT("WebSockets"));
  StubModuleTerraport().StartupModule();
  Warnings = StubWarnings.size();
  Scene.SceneUrl = FString(UTF8_TO_TCHAR(Url.c_str()));
  User.FadeS = 0.01f;
  Scene.BeginPlay();
}

void FVisit::Frame() {
  ++GFrameCounter;
  (void)EngineNetwork::Pump();
  Scene.Tick(0.005f);
  User.TickComponent(0.005f, LEVELTICK_All, nullptr);
  Group.TickComponent(0.005f, LEVELTICK_All, nullptr);
}

bool FVisit::Until(const std::function<bool()>& Holds) {
  const auto Start = std::chrono::steady_clock::now();
  while (!Holds()) {
    if (!Refusal.empty() || std::chrono::steady_clock::now() - Start > std::chrono::duration<double>(TimeoutS)) return false;
    const auto FrameStart = std::chrono::steady_clock::now();
    Frame();
    std::this_thread::sleep_until(FrameStart + std::chrono::milliseconds(2));
  }
  return true;
}

void FVisit::Stand(const FVector& At) {
  FTerraportGroundHit Ground;
  if (!Scene.GroundAt(At, Ground)) {
    Feet.push_back("null");
    return;
  }
  Pawn.SetActorLocation(Ground.Location, false, nullptr, ETeleportType::TeleportPhysics);
  Scene.FeetOf = &Pawn;
  Frame();
  Feet.push_back(Format("[%.17g, %d, %.17g]", Ground.Location.Z / 100.0, Ground.Segment, SolidHeight(Ground.Location) / 100.0));
}

void FVisit::Note(const FTerraportPlace& Place) {
  Places.push_back(Format("[\"%s\", %d, %.17g]", TextOf(Place.Label).c_str(), Place.Region, Place.RadiusM));
}

void FVisit::Note(const FTerraportCoarserPiece& Piece) {
  Pieces.push_back(Format("[%.17g, \"%s\", ", Piece.Cost, TextOf(Piece.Label).c_str()) + NumbersOf(Piece.Regions) + "]");
}

void FVisit::Expect(bool bHolds, const char* Rule) {
  if (!bHolds) {
    std::printf("does not hold: %s\n", Rule);
    ++Faults;
  }
}

std::string FVisit::Json(const std::string& Failure) const {
  std::vector<int64> Hidden;
  const terraport::Stage* Stage = Scene.GetSession() != nullptr ? Scene.GetSession()->GetStage() : nullptr;
  for (std::size_t Face = 0; Stage != nullptr && Face < 8 * Stage->hiddenFaces().size(); ++Face) {
    if (((Stage->hiddenFaces()[Face / 8] >> (Face % 8)) & 1) != 0) Hidden.push_back(int64(Face));
  }
  const EngineNetwork::FPace Pace = EngineNetwork::Pace();
  const terraport::SessionCounts Counts = Stage != nullptr ? Scene.GetSession()->GetCounts() : terraport::SessionCounts();
  const FTerraportGroup Now = Group.GetGroup();
  std::string Text = "{\"failure\": " + (Failure.empty() ? std::string("null") : "\"" + Failure + "\"");
  const std::pair<const char*, const std::vector<std::string>*> Lists[] = {{"plans", &Plans}, {"landings", &Landings},
      {"links", &Links}, {"failures", &Failures}, {"picks", &Picks}, {"feet", &Feet}, {"events", &Events},
      {"gatherings", &Gatherings}, {"places", &Places}, {"pieces", &Pieces}};
  for (const auto& [Name, Items] : Lists) Text += Format(", \"%s\": ", Name) + ListOf(*Items);
  Text += ", \"visible\": " + NumbersOf(ShownIds(Scene)) + ", \"hidden_base_faces\": " + NumbersOf(Hidden);
  Text += Format(", \"payload_bytes\": %llu, \"repeated_bytes\": %llu, \"held_bytes\": %lld, \"member\": %lld",
      (unsigned long long)Counts.payloadBytes, (unsigned long long)Counts.repeatedBytes,
      Stage != nullptr ? (long long)const_cast<FVisit*>(this)->Scene.TakeStats().HeldBytes : 0LL, (long long)Now.Member);
  return Text +
      Format(", \"frame_time_s\": %g, \"frames\": %d, \"rounds\": %d, \"warnings\": %zu, \"faults\": %d}", Pace.FrameTimeS,
          Pace.Frames, Pace.Rounds, Warnings, Faults);
}
