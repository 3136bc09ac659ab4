#include "files.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <system_error>

namespace terraport::tools {

std::vector<std::uint8_t> readFile(const std::string& path) {
  std::FILE* file = std::fopen(path.c_str(), "rb");
  if (file == nullptr) {
    std::fprintf(stderr, "error: cannot read %s\n", path.c_str());
    std::exit(2);
  }
  std::vector<std::uint8_t> bytes;
  std::uint8_t buffer[65536];
  for (std::size_t size = 0; (size = std::fread(buffer, 1, sizeof buffer, file)) > 0;) {
    bytes.insert(bytes.end(), buffer, buffer + size);
  }
  std::fclose(file);
  return bytes;
}

void writeFile(const std::string& path, const void* data, std::size_t size) {
  std::FILE* file = std::fopen(path.c_str(), "wb");
  const bool written = file != nullptr && std::fwrite(data, 1, size, file) == size;
  if (file == nullptr || std::fclose(file) != 0 || !written) {
    std::fprintf(stderr, "error: cannot write %s\n", path.c_str());
    std::exit(2);
  }
}

std::vector<std::string> filesOf(const std::string& folder, const std::string& suffix, bool unless) {
  std::vector<std::string> names;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
    const std::string name = entry.path().filename().string();
    if (endsWith(name, suffix) != unless) {
      names.push_back(name);
    }
  }
  std::sort(names.begin(), names.end());
  return names;
}

bool endsWith(const std::string& text, const std::string& tail) {
  return text.size() >= tail.size() && text.compare(text.size() - tail.size(), tail.size(), tail) == 0;
}

SharedSceneFiles filesWith(const JsonValue& attributes) {
  auto files = std::make_shared<SceneFiles>();
  for (const JsonValue scale : attributes.items()) {
    AttributeInfo& attribute = files->manifest.attributes.emplace_back();
    attribute.name = scale.member("name").text().value_or("");
    attribute.offset = scale.member("offset").number().value_or(0.0);
    attribute.step = scale.member("step").number().value_or(0.0);
  }
  return files;
}

}  // namespace terraport::tools
