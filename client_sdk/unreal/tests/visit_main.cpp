// The scene's actor, its user and its group, on an engine of stubs, against a live service.
//
//   terraport-visit URL [--NAME VALUE ...] STEP ...      prints a line of JSON; exit code 1 where a step or a rule fails
//
// Options: token, token-file (read for each connection), radius, disk (folder), disk-mib, cache-mib, credit-kib, max-triangles,
// max-segments, max-gpu-mib, frame-budget-ms, auto-show (0 or 1), coarse (0 or 1), late (1: the engine's WebSockets module was
// loaded before the plugin), buffer-bytes (what a round of its thread takes), timeout-s.
// Steps, in metres of the scene frame: land:X,Y,Z,R[,INNER,DEADLINE_MS] until shown; start:... until planned; wait until the
// newest is shown; swaps:N until so many were shown in all; aim:X,Y,Z,R; pick:X,Y,Z,DX,DY,DZ; stand:X,Y,Z; places:REGION, with
// the pieces that the region is part of; pause:MS; touch:PATH, which creates a file; reconnect[:TOKEN];
// join:NAME,guide|member,OWN; people:N; gather:X,Y,Z,R; barrier:N; follow:0|1; tour: see tour.cpp.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <sstream>

#include "visit.h"

namespace {
std::vector<double> NumbersOf(const std::string& Text) {
  std::vector<double> Numbers;
  std::istringstream Stream(Text);
  for (std::string Part; std::getline(Stream, Part, ',');) Numbers.push_back(std::atof(Part.c_str()));
  Numbers.resize(8, 0.0);
  return Numbers;
}

FString StringOf(const std::string& Text) {
  return FString(UTF8_TO_TCHAR(Text.c_str()));
}

std::string FileText(const std::string& Path) {
  std::ifstream File(Path);
  std::string Text;
  std::getline(File, Text);
  return Text;
}

bool TakeOption(FVisit& Visit, const std::string& Name, const std::string& Value, unsigned& Buffer, bool& bLate) {
  const double Number = std::atof(Value.c_str());
  FTerraportBudgets& Budgets = Visit.Scene.CustomBudgets;
  if (Name == "token")
    Visit.Scene.Token = StringOf(Value);
  else if (Name == "token-file") {
    FTerraportTokenProvider Provider;
    Provider.BindLambda([Value]() { return StringOf(FileText(Value)); });
    Visit.Scene.SetTokenProvider(Provider);
  } else if (Name == "radius")
    Visit.User.RadiusM = Number;
  else if (Name == "disk")
    setenv("TERRAPORT_STUB_SAVED", Value.c_str(), 1);
  else if (Name == "disk-mib")
    Budgets.DiskMiB = int32(Number);
  else if (Name == "cache-mib")
    Budgets.CacheMiB = int32(Number);
  else if (Name == "credit-mib")
    Budgets.CreditMiB = int32(Number);
  else if (Name == "max-triangles")
    Budgets.MaxTriangles = int64(Number);
  else if (Name == "max-segments")
    Budgets.MaxSegments = int32(Number);
  else if (Name == "max-gpu-mib")
    Budgets.MaxGpuMebibytes = int32(Number);
  else if (Name == "auto-show")
    Visit.Scene.bAutoShow = Number > 0;
  else if (Name == "coarse")
    Visit.Scene.bShowsCoarse = Number > 0;
  else if (Name == "timeout-s")
    Visit.TimeoutS = Number;
  else if (Name == "buffer-bytes")
    Buffer = unsigned(Number);
  else if (Name == "late")
    bLate = Number > 0;
  else
    return false;
  return true;
}

/// Why a step failed; empty where it did not.
std::string Do(FVisit& Visit, const std::string& Step) {
  const std::size_t Colon = std::min(Step.find(':'), Step.size());
  const std::string Verb = Step.substr(0, Colon), Given = Colon < Step.size() ? Step.substr(Colon + 1) : "";
  const std::vector<double> N = NumbersOf(Given);
  const FVector At = Visit.World3(N[0], N[1], N[2]);
  FTerraportLandOptions Options;
  Options.InnerRadiusM = N[4];
  Options.DeadlineMs = int32(N[5]);
  const auto Await = [&Visit](const std::function<bool()>& Holds) { return Visit.Until(Holds) ? "" : Visit.Failure(); };
  if (Verb == "tour") {
    Tour(Visit, N[0]);
    return Visit.Faults == 0 ? "" : "rules do not hold";
  }
  if (Verb == "land" || Verb == "start") {
    const int64 Landing = Visit.Scene.Land(At, N[3], Options);
    Visit.Newest = Landing > 0 ? Landing : 1;
    return Await([&] { return (Verb == "land" ? Visit.LastShown : Visit.LastPlanned) >= Visit.Newest; });
  }
  if (Verb == "wait") return Await([&] { return Visit.LastShown >= Visit.Newest; });
  if (Verb == "swaps") return Await([&] { return Visit.Swaps >= int(N[0]); });
  if (Verb == "touch") return std::ofstream(Given) ? "" : "cannot be written";
  if (Verb == "aim") {
    // Over when nothing more has come for a while.
    Visit.Until([&] { return Visit.Scene.IsOpen() && Visit.bOpen; });
    Visit.Scene.Aim(At, N[3]);
    int64 Bytes = -1;
    for (int Still = 0; Still < 60; ++Still) {
      Visit.Frame();
      const int64 Now = Visit.Scene.TakeStats().PayloadBytes;
      Still = Now != Bytes ? 0 : Still;
      Bytes = Now;
    }
    return "";
  }
  if (Verb == "pick") {
    Visit.Until([&] { return Visit.Scene.IsOpen() && Visit.bOpen; });
    const std::size_t Before = Visit.Picks.size();
    Visit.Scene.Pick(At, Visit.World3(N[3], N[4], N[5]));
    return Await([&] { return Visit.Picks.size() > Before; });
  }
  if (Verb == "stand") {
    Visit.Stand(At);
    return "";
  }
  if (Verb == "places") {
    for (const FTerraportPlace& Place : Visit.Scene.GetPlaces()) Visit.Note(Place);
    for (const FTerraportCoarserPiece& Piece : Visit.Scene.GetCoarserPieces(int32(N[0]))) Visit.Note(Piece);
    return "";
  }
  if (Verb == "pause") {
    const auto End = std::chrono::steady_clock::now() + std::chrono::milliseconds(int(N[0]));
    while (std::chrono::steady_clock::now() < End) Visit.Frame();
    return "";
  }
  if (Verb == "reconnect") {
    Visit.Refusal.clear();
    Visit.Scene.Reconnect(StringOf(Given));
    return "";
  }
  if (Verb == "join") {
    const std::size_t One = Given.find(','), Two = Given.find(',', One + 1);
    Visit.Until([&] { return Visit.Scene.IsOpen(); });
    const std::string Role = Given.substr(One + 1, Two == std::string::npos ? Two : Two - One - 1);
    const std::string Own = Two == std::string::npos ? "" : Given.substr(Two + 1);
    Visit.Group.Join(StringOf(Given.substr(0, One)), Role == "guide", StringOf(Own));
    return Await([&] { return !Visit.Group.GetGroup().Name.IsEmpty(); });
  }
  if (Verb == "people") return Await([&] { return Visit.Group.GetGroup().Members.Num() >= int32(N[0]); });
  if (Verb == "gather") {
    Visit.Group.Gather(At, N[3]);
    return Await([&] { return Visit.Group.GetGroup().Gathering > 0; });
  }
  if (Verb == "barrier") return Await([&] { return Visit.Gathered >= int64(N[0]); });
  if (Verb == "follow") {
    Visit.Group.bFollow = N[0] > 0;
    return "";
  }
  return "no such step";
}
}  // namespace

int main(int Count, char** Arguments) {
  static FVisit Visit;
  unsigned Buffer = 32 * 1024;
  bool bLate = false;
  int At = 2;
  Visit.Scene.Device = ETerraportDevice::Custom;
  Visit.Scene.CustomBudgets.DiskMiB = 0;
  for (; At + 1 < Count && std::string(Arguments[At]).rfind("--", 0) == 0; At += 2) {
    if (!TakeOption(Visit, Arguments[At] + 2, Arguments[At + 1], Buffer, bLate)) {
      std::printf("no such option: %s\n", Arguments[At]);
      return 2;
    }
  }
  Visit.Start(Arguments[1], Buffer, bLate);
  std::string Failure;
  for (; At < Count && Failure.empty(); ++At) {
    Failure = Do(Visit, Arguments[At]);
    if (!Failure.empty()) Failure = std::string(Arguments[At]) + ": " + Failure;
  }
  std::printf("%s\n", Visit.Json(Failure).c_str());
  std::fflush(stdout);
  Visit.Scene.EndPlay(EEndPlayReason::Destroyed);
  // Tasks and threads of the stubs end by themselves.
  std::_Exit(Failure.empty() && Visit.Faults == 0 ? 0 : 1);
}
