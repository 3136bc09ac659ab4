#pragma once

#include "CoreMinimal.h"

enum EPixelFormat { PF_B8G8R8A8 = 2, PF_DXT1 = 5, PF_ETC2_RGB = 51, PF_MAX = 100 };

struct FPixelFormatInfo {
  bool Supported = true;
};

/// What the device's graphics have; a desktop's by default.
inline FPixelFormatInfo GPixelFormats[PF_MAX];
