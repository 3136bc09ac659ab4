#pragma once

#include "TerraportGroupComponent.h"
#include "TerraportScene.h"
#include "TerraportUserComponent.h"

#include "Camera/CameraComponent.h"
#include "Engine/World.h"

#include <functional>
#include <string>
#include <vector>

/// What the render thread would draw now, of every component that is there.
struct FDrawn {
  int64 Triangles = 0;
  int Pieces = 0;
  int Components = 0;
  int Alive = 0;
};
FDrawn Drawn();

/// Height of the highest solid face over a location, centimetres; far below where there is none.
double SolidHeight(const FVector& At);

/// A game with one scene, one user and its group, frame by frame; notes what it is told.
class FVisit {
 public:
  FVisit();

  /// Start the engine as it comes, and play.
  void Start(const std::string& Url, unsigned BufferBytes, bool bLate);
  void Frame();
  /// Frames until it holds; false after TimeoutS in which the socket brought nothing, or a failure that is final.
  bool Until(const std::function<bool()>& Holds);
  /// A place of the scene frame.
  FVector World3(double X, double Y, double Z) const { return FVector(100.0 * X, 100.0 * Z, 100.0 * Y); }
  /// Note the ground at a place, and how high it is solid there.
  void Stand(const FVector& At);
  void Note(const FTerraportPlace& Place);
  void Note(const FTerraportCoarserPiece& Piece);
  void Expect(bool bHolds, const char* Rule);
  /// Why a step did not come to its end.
  std::string Failure() const { return Refusal.empty() ? "timeout" : Refusal; }
  std::string Json(const std::string& Failure) const;

  ATerraportScene Scene;
  UTerraportUserComponent User;
  UTerraportGroupComponent Group;
  UWorld World;
  AActor Pawn;
  UCameraComponent Camera;
  double TimeoutS = 30.0;
  bool bOpen = false;
  int64 Newest = 0, LastPlanned = 0, LastReady = 0, LastShown = 0, Gathered = 0;
  int Swaps = 0;
  int Faults = 0;
  std::size_t Warnings = 0;
  std::string Refusal;
  /// JSON of each.
  std::vector<std::string> Plans, Landings, Links, Failures, Picks, Feet, Events, Gatherings, Places, Pieces;
};

/// Everything that a visitor does, in one go, with what must hold after each: land, supersede, return, teleport, walk, groups,
/// rings, the editor's preview, closing.
void Tour(FVisit& Visit, double RadiusM);
