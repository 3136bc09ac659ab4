#pragma once

#include "ImageCore.h"
#include "Modules/ModuleManager.h"

class IImageWrapperModule : public IModuleInterface {
 public:
  virtual bool DecompressImage(const void* Bytes, int64 Size, FImage& Image) = 0;
  static inline IImageWrapperModule* Stub = nullptr;
};
