#pragma once

#include "CoreMinimal.h"
#include "PixelFormat.h"

enum TextureAddress { TA_Wrap, TA_Clamp };
enum TextureFilter { TF_Nearest, TF_Bilinear, TF_Trilinear };

struct FTexturePlatformData;

class UTexture : public UObject {
 public:
  uint8 SRGB : 1;
  uint8 NeverStream : 1;
  TextureFilter Filter = TF_Nearest;
  virtual void UpdateResource() { bStubUpdated = true; }
  virtual void ReleaseResource() { bStubReleased = true; }
  bool bStubReleased = false;
  bool bStubUpdated = false;
};

class UTexture2D : public UTexture {
 public:
  TextureAddress AddressX = TA_Wrap, AddressY = TA_Wrap;
  static UTexture2D* CreateTransient(int32 Width, int32 Height, EPixelFormat = PF_B8G8R8A8, const FName = NAME_None);
  FTexturePlatformData* GetPlatformData() { return StubData.get(); }
  std::shared_ptr<FTexturePlatformData> StubData;
  EPixelFormat StubFormat = PF_B8G8R8A8;
};
