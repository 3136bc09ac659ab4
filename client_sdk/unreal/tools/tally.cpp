#include "tally.h"

#include <cstdio>

namespace terraport::tools {

void Tally::add(const std::string& name, const std::string& failure) {
  if (failure.empty()) {
    ++passed_;
    return;
  }
  ++failed_;
  std::printf("failed: %s: %s\n", name.c_str(), failure.c_str());
}

void Tally::decline(const std::string& name, const std::string& reason) {
  std::printf("declined: %s: %s\n", name.c_str(), reason.c_str());
}

int Tally::finish() const {
  std::printf("%d passed, %d failed\n", passed_, failed_);
  return failed_ == 0 && passed_ > 0 ? 0 : 1;
}

}  // namespace terraport::tools
