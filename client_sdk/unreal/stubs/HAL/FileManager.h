#pragma once

#include "CoreMinimal.h"

/// Paths of this machine are absolute already.
class IFileManager {
 public:
  static IFileManager& Get() {
    static IFileManager Manager;
    return Manager;
  }
  FString ConvertToAbsolutePathForExternalAppForWrite(const TCHAR* Filename) { return FString(Filename); }
};
