#pragma once

#include "CoreMinimal.h"

struct FPlatformMemoryConstants {
  /// Bytes of main memory.
  uint64 TotalPhysical = 0;
};

struct FPlatformMemory {
  static const FPlatformMemoryConstants& GetConstants() {
    static FPlatformMemoryConstants Constants{uint64(8) << 30};
    return Constants;
  }
};
