#pragma once

#include "CoreMinimal.h"

namespace ERawImageFormat {
enum Type : uint8 { G8, BGRA8 };
} // namespace ERawImageFormat

enum class EGammaSpace : uint8 { Linear, Pow22, sRGB };

struct FImage {
  TArray64<uint8> RawData;
  int32 SizeX = 0;
  int32 SizeY = 0;
  void ChangeFormat(ERawImageFormat::Type, EGammaSpace) {}
};
