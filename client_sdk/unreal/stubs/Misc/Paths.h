#pragma once

#include "CoreMinimal.h"

#include <cstdlib>

/// Nothing is kept unless a test says where: a run begins as the first one.
class FPaths {
 public:
  static FString ProjectSavedDir() {
    const char* Folder = std::getenv("TERRAPORT_STUB_SAVED");
    return UTF8_TO_TCHAR(Folder != nullptr ? Folder : "/dev/null");
  }
};
