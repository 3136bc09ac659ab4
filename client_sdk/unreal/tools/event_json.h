#pragma once

#include "Terraport/Types.h"
#include "json_text.h"

namespace terraport::tools {

/// One event of a stream as a JSON object, in the words of tests/engines/README.md.
void describeEvent(JsonText& json, const StreamEvent& event);

void describeStats(JsonText& json, const StreamStats& stats);

}  // namespace terraport::tools
