#pragma once

#include "CoreMinimal.h"

struct ConstructorHelpers {
  template <typename T>
  struct FObjectFinder {
    TObjectPtr<T> Object;
    FObjectFinder(const TCHAR*) {}
  };

  template <typename T>
  struct FObjectFinderOptional {
    FObjectFinderOptional(const TCHAR*, uint32 = LOAD_None) {}
    T* Get() { return nullptr; }
    bool Succeeded() { return Get() != nullptr; }
  };
};
