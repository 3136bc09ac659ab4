#include "visit.h"

#include "PrimitiveSceneProxy.h"

#include <cmath>

namespace {
void ExpectRing(FVisit& Visit, const FVector& Place, double RadiusM) {
  FTerraportPlan Plan;
  Visit.Scene.OnPlan.AddLambda([&Plan](const FTerraportPlan& New) { Plan = New; });
  const auto Land = [&] {
    const int64 Landing = Visit.Scene.Land(Place, RadiusM, FTerraportLandOptions());
    Visit.Expect(Visit.Until([&] { return Visit.LastShown == Landing; }), "a landing with or without a ring is shown");
    Visit.Expect(Plan.EffectiveRadiusM == RadiusM, "full detail reaches to the radius");
    return Plan.CoarseRadiusM;
  };
  const double RingM = Land();
  const FVector Beyond = Place + FVector(200.0 * RadiusM, 0.0, 1.0e5);
  FTerraportGroundHit Ground;
  const bool bHasRing = RingM > 0.0;
  Visit.Expect(
      !bHasRing || (Visit.Scene.GroundAt(Beyond, Ground) && Ground.Segment >= 0), "ground in the ring tells its segment");
  const FDrawn With = Drawn();
  Visit.Scene.bShowsCoarse = false;
  Visit.Expect(Land() == 0.0, "a ring that is switched off is not asked for");
  Visit.Expect(!bHasRing || (Visit.Scene.GroundAt(Beyond, Ground) && Ground.Segment < 0), "without a ring it is the base");
  Visit.Expect((Drawn().Pieces < With.Pieces) == bHasRing, "fewer pieces are drawn");
  Visit.Scene.bShowsCoarse = true;
  Visit.Scene.OnPlan.Clear();
}

/// By the group's component: a seat, a landing of the group that is followed, and its barrier opens; then one that is not.
void ExpectTogether(FVisit& Visit, const FVector& Place, double RadiusM) {
  FTerraportGroup Called, Gathered;
  Visit.Group.OnCalled.AddLambda([&Called](const FTerraportGroup& Group) { Called = Group; });
  Visit.Group.OnGathered.AddLambda([&Gathered](const FTerraportGroup& Group) { Gathered = Group; });
  Visit.Group.OnRefused.AddLambda([&Visit](const FString&) { Visit.Expect(false, "nothing of the group is refused"); });
  Visit.Expect(!Visit.Group.Join(TEXT("a tour"), true, TEXT("Ada")), "a name that cannot be is refused at once");
  Visit.Expect(Visit.Group.Join(TEXT("tour"), true, TEXT("Ada")), "a seat is asked for");
  Visit.Expect(Visit.Until([&Visit] { return Visit.Group.GetGroup().Members.Num() == 1; }), "there is a list of who is there");
  Visit.Expect(Visit.Group.GetGroup().bGuide && Visit.Group.GetGroup().Members[0].bPresent, "the guide is there");
  Visit.Expect(Visit.Group.Gather(Place, RadiusM), "the group is landed");
  Visit.Expect(Visit.Until([&Gathered] { return Gathered.Gathering == 1; }), "everybody is there");
  Visit.Expect(Called.Gathering == 1 && Called.Location.Equals(Place, 0.5), "it was told where");
  Visit.Expect(Gathered.Ready.Num() == 1 && Gathered.Ready[0] == Gathered.Member, "this one too");
  Visit.Group.bFollow = false;
  const int Swaps = Visit.Swaps;
  Visit.Until([] { return true; });
  Visit.Expect(Visit.Group.Gather(Place + FVector(500.0, 0.0, 0.0), RadiusM), "the group is landed elsewhere");
  Visit.Group.TickComponent(0.005f, LEVELTICK_All, nullptr);
  Visit.Expect(Visit.Until([&Gathered] { return Gathered.Gathering == 2; }), "nobody is waited for");
  Visit.Expect(Gathered.Missing.Num() == 1 && Visit.Swaps == Swaps, "who does not follow stays");
  Visit.Group.EndPlay(EEndPlayReason::Destroyed);
  Visit.Expect(Visit.Group.GetGroup().Name.IsEmpty(), "the seat was given up");
}

/// What is drawn is what the stage says, to the triangle.
void ExpectShown(FVisit& Visit, int64 Landing) {
  Visit.Expect(Visit.LastShown == Landing, "the newest landing is the one that is shown");
  Visit.Expect(Visit.Scene.GetStatus().Phase == ETerraportLandingPhase::Shown, "its phase is Shown");
  const FTerraportStats Stats = Visit.Scene.TakeStats();
  Visit.Expect(Stats.VisibleSegments > 0, "segments are shown");
  Visit.Expect(Drawn().Triangles == Stats.VisibleTriangles, "the triangles that are drawn are those of the stage");
}

/// An aim meets ground, unless something of the asked types stands before it.
void ExpectObstacles(FVisit& Visit, const FVector& Above) {
  FTerraportGroundHit Hit;
  const FVector Down(0.01, 0.0, -1.0);
  Visit.World.StubWallX = Above.X + 1.0;
  Visit.World.StubWallType = ObjectTypeQuery2;
  Visit.Expect(Visit.User.TryAim(Above, Down, 1.0e6, Hit), "without a mask nothing stops an aim");
  Visit.User.Obstacles.Add(ObjectTypeQuery1);
  Visit.Expect(Visit.User.TryAim(Above, Down, 1.0e6, Hit), "what is of another type does not stop it");
  Visit.User.Obstacles.Add(ObjectTypeQuery2);
  Visit.Expect(!Visit.User.TryAim(Above, Down, 1.0e6, Hit), "what is of that type does");
  Visit.World.StubWallOf = &Visit.Scene;
  Visit.Expect(Visit.User.TryAim(Above, Down, 1.0e6, Hit), "the scene's own bodies are ground");
  Visit.User.Obstacles.Reset();
}

/// In the editor: base and landing below the viewport's camera, anew when it has moved, and gone when it is switched off.
void ExpectPreview(FVisit& Visit, const FVector& Middle) {
  Visit.World.WorldType = EWorldType::Editor;
  Visit.Scene.StubWorld = &Visit.World;
  Visit.Scene.Close();
  Visit.World.ViewLocationsRenderedLastFrame.Add(Middle + FVector(0.0, 0.0, 5.0e4));
  Visit.Scene.Tick(0.005f);
  Visit.Expect(!Visit.Scene.ShouldTickIfViewportsOnly() && Drawn().Alive == 0, "without the switch there is no preview");
  Visit.Scene.bPreviewInEditor = true;
  Visit.Scene.PreviewRadiusM = 15.0;
  const int SwapsBefore = Visit.Swaps;
  Visit.Expect(Visit.Scene.ShouldTickIfViewportsOnly(), "it ticks without play");
  Visit.Expect(Visit.Until([&] { return Visit.Swaps > SwapsBefore && Visit.Scene.TakeStats().VisibleSegments > 0; }),
      "the preview lands below the camera");
  const int64 Landing = Visit.Scene.GetStatus().Landing;
  Visit.World.ViewLocationsRenderedLastFrame[0] += FVector(100.0, 0.0, 0.0);
  Visit.Scene.Tick(0.005f);
  Visit.Expect(Visit.Scene.GetStatus().Landing == Landing, "a metre aside nothing is asked for");
  Visit.World.ViewLocationsRenderedLastFrame[0] += FVector(900.0, 0.0, 0.0);
  Visit.Scene.Tick(0.005f);
  Visit.Expect(Visit.Scene.GetStatus().Landing == Landing + 1, "farther away it lands anew");
  Visit.Scene.bPreviewInEditor = false;
  FPropertyChangedEvent Event;
  Visit.Scene.PostEditChangeProperty(Event);
  Visit.Scene.Tick(0.005f);
  Visit.Expect(Drawn().Alive == 0 && FRenderResource::StubGpuBytes == 0, "switched off, nothing of it is left");
}

/// Bodies stand where feet do: the ground is solid around them, wherever they have walked.
void ExpectSolid(FVisit& Visit) {
  Visit.Scene.FeetOf = &Visit.Pawn;
  for (int Step = 0; Step < 10; ++Step) {
    FTerraportGroundHit Ground;
    const FVector Next = Visit.Pawn.GetActorLocation() + FVector(130.0, 40.0, 0.0);
    if (!Visit.Scene.GroundAt(Next + FVector(0.0, 0.0, 100.0), Ground)) {
      continue; // Beyond the scene.
    }
    Visit.Pawn.SetActorLocation(Ground.Location, false, nullptr, ETeleportType::TeleportPhysics);
    Visit.Scene.Tick(0.011f);
    Visit.Expect(std::abs(SolidHeight(Ground.Location) - Ground.Location.Z) < 2.0, "solid ground is where it is shown");
  }
  Visit.Scene.FeetOf = nullptr;
}
} // namespace

void Tour(FVisit& Visit, double RadiusM) {
  Visit.User.RadiusM = RadiusM;
  if (!Visit.Until([&Visit] { return Visit.Scene.IsOpen(); })) {
    Visit.Expect(false, "the scene opens");
    return;
  }
  const FBox Bounds = Visit.Scene.GetSceneBounds();
  const FVector Middle = (Bounds.Min + Bounds.Max) * 0.5;
  const FVector Corner = Bounds.Min * 0.7 + Bounds.Max * 0.3;

  // 1. The first landing.
  const int64 First = Visit.Scene.Land(Middle, RadiusM, FTerraportLandOptions());
  Visit.Expect(Visit.Until([&] { return Visit.LastReady == First; }), "the first landing is ready");
  Visit.Expect(Visit.Until([&] { return Visit.LastShown == First; }), "the first landing is shown");
  ExpectShown(Visit, First);

  // 2. Two at once: the newer one counts, and the older one is never shown.
  Visit.Scene.Land(Corner, RadiusM, FTerraportLandOptions());
  const int64 Second = Visit.Scene.Land(Bounds.Min * 0.4 + Bounds.Max * 0.6, RadiusM, FTerraportLandOptions());
  Visit.Expect(Visit.Until([&] { return Visit.LastShown == Second; }), "the newer of two landings is shown");
  ExpectShown(Visit, Second);
  Visit.Expect(Visit.Swaps == 2, "the landing that was superseded was not");

  // 3. Back.
  const int64 Third = Visit.Scene.Land(Middle, RadiusM, FTerraportLandOptions());
  Visit.Expect(Visit.Until([&] { return Visit.LastShown == Third; }), "a landing where one was before is shown");
  ExpectShown(Visit, Third);

  // 4. Ground, and a teleport onto it.
  FTerraportGroundHit Ground;
  Visit.Expect(Visit.Scene.GroundAt(Middle + FVector(0.0, 0.0, 1.0e6), Ground), "there is ground in the middle");

  Visit.Expect(Visit.User.TeleportTo(Corner), "a teleport begins");
  Visit.Expect(!Visit.Scene.bAutoShow, "the swap waits for the dark");
  Visit.Expect(Visit.Until([&Visit] { return !Visit.User.IsTeleporting(); }), "it ends");
  Visit.Expect(Visit.Scene.bAutoShow, "the scene shows by itself again");
  ExpectShown(Visit, Visit.Scene.GetStatus().Landing);
  const FVector Head = Visit.Pawn.GetActorLocation() + FVector(30.0, 40.0, 0.0);
  Visit.Expect(Head.Equals(FVector(Corner.X, Corner.Y, Head.Z), 0.5), "the head is above the place");
  Visit.Expect(Visit.Scene.GroundAt(Head + FVector(0.0, 0.0, 100.0), Ground) && Ground.Location.Equals(Head, 1.0),
      "the feet are on the ground");

  ExpectSolid(Visit);
  ExpectObstacles(Visit, Middle + FVector(0.0, 0.0, 1.0e5));
  FTerraportPlace Place;
  Visit.Expect(!Visit.Scene.FindPlace(TEXT("no such place"), Place) && !Visit.User.TeleportToPlace(TEXT("no such place")),
      "a name that nobody gave is no place");
  for (const FTerraportPlace& Each : Visit.Scene.GetPlaces()) {
    Visit.Expect(Visit.Scene.FindPlace(Each.Label, Place) && Place.RadiusM > 0.0, "each place is found by its name");
  }

  ExpectTogether(Visit, Middle, RadiusM);
  ExpectRing(Visit, Middle, RadiusM);

  // 5. The survey's reference system.
  FVector Survey, Back;
  Visit.Expect(Visit.Scene.WorldToSurvey(Head, Survey) && Visit.Scene.SurveyToWorld(Survey, Back) && Back.Equals(Head, 0.01),
      "places go to the survey's frame and back");

  // 6. The end.
  Visit.Scene.EndPlay(EEndPlayReason::Destroyed);
  Visit.Expect(Drawn().Alive == 0, "closing leaves no component");
  Visit.Expect(FRenderResource::StubGpuBytes == 0, "closing leaves nothing on the graphics");
  ExpectPreview(Visit, Middle);
}
