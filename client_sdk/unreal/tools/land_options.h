#pragma once

#include <optional>
#include <string>
#include <vector>

#include "Terraport/StreamOptions.h"

namespace terraport::tools {

/// One step of a visit, such as `land:0,1,0,60`.
struct Step {
  /// As it was written.
  std::string text;
  /// land, start, wait, aim, pick, stand, pause, reconnect.
  std::string kind;
  std::vector<double> numbers;
  /// What stands behind the colon, where it is not numbers.
  std::string argument;
};

/// What terraport-land was asked for.
struct LandRequest {
  StreamOptions stream;
  /// Whether a StreamThread is used, or a SceneStream pumped here.
  bool isThreaded = false;
  /// Of the whole visit.
  double timeoutS = 60.0;
  /// Where decoded normals and payloads are written; empty for nowhere.
  std::string dumpFolder;
  /// Whether the visit is staged, as in an engine: base mesh loaded, segments decoded, swaps made.
  bool isStaged = false;
  std::vector<Step> steps;
};

/// Read the command line; nothing, with a message on standard error, where it is wrong.
std::optional<LandRequest> parseLand(int count, char** arguments);

}  // namespace terraport::tools
