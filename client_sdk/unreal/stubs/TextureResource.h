#pragma once

#include "Engine/Texture2D.h"

enum EBulkDataLockFlags { LOCK_READ_ONLY = 1, LOCK_READ_WRITE = 2 };

class FByteBulkData {
 public:
  void* Lock(uint32) { return StubBytes.data(); }
  void* Realloc(int64 Count) {
    StubBytes.resize(std::size_t(Count));
    return StubBytes.data();
  }
  void Unlock() const {}
  std::vector<uint8> StubBytes;
};

struct FTexture2DMipMap {
  uint16 SizeX = 0;
  uint16 SizeY = 0;
  FByteBulkData BulkData;
};

struct FTexturePlatformData {
  TIndirectArray<FTexture2DMipMap> Mips;
};

inline UTexture2D* UTexture2D::CreateTransient(int32 Width, int32 Height, EPixelFormat Format, const FName) {
  UTexture2D* Texture = new UTexture2D();
  Texture->StubFormat = Format;
  Texture->StubData = std::make_shared<FTexturePlatformData>();
  FTexture2DMipMap* Mip = new FTexture2DMipMap();
  Mip->SizeX = uint16(Width);
  Mip->SizeY = uint16(Height);
  Texture->StubData->Mips.Add(Mip);
  return Texture;
}
