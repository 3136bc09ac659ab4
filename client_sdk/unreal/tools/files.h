#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "Terraport/Json.h"
#include "Terraport/SceneFiles.h"

namespace terraport::tools {

/// Everything of a file; ends the program where it cannot be read.
std::vector<std::uint8_t> readFile(const std::string& path);

/// Write a file anew; ends the program where that fails.
void writeFile(const std::string& path, const void* data, std::size_t size);

/// Names of the files of a folder that end in `suffix` (or not, with `unless`), in order.
std::vector<std::string> filesOf(const std::string& folder, const std::string& suffix, bool unless = false);

bool endsWith(const std::string& text, const std::string& tail);

/// Files of a scene that has attributes and nothing else: a list of objects with `name`, `offset` and `step`.
SharedSceneFiles filesWith(const JsonValue& attributes);

}  // namespace terraport::tools
