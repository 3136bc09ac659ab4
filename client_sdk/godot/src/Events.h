// What happened, and what is known, as the engine's lists and dictionaries.
#pragma once

#include <optional>
#include <string>

#include "Godot.h"
#include "Terraport/Places.h"
#include "Terraport/SceneFiles.h"
#include "Terraport/SceneStage.h"
#include "Terraport/Types.h"

namespace terraport::godot {

/// What happened in one update: a list of [name, facts].
class EventList {
 public:
  void add(const char* name, const Dictionary& facts);
  void failed(const std::string& code, const std::string& message, std::int64_t landing, bool isFinal);
  /// An event of the stream; those that nobody needs to know are left out.
  void add(const StreamEvent& event);
  void add(const SceneSwap& swap);
  Variant variant() const { return list_.variant(); }

 private:
  List list_;
};

Variant describe(const LandingStatus& status);
Variant describe(const SceneManifest& manifest);
/// Nil without a seat.
Variant describe(const std::optional<GroupFacts>& group);
Variant describe(const std::vector<RegionFacts>& regions);
Variant describe(const std::vector<Place>& places);
Variant describe(const std::vector<CoarserPiece>& pieces);

}  // namespace terraport::godot
