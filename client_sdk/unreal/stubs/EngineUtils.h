#pragma once

#include "Engine/World.h"

template <typename T>
class TActorIterator {
 public:
  explicit TActorIterator(const UWorld* World) : StubFirst(static_cast<T*>(World->StubActor)) {}
  explicit operator bool() const { return StubFirst != nullptr; }
  T* operator*() const { return StubFirst; }

 private:
  T* StubFirst = nullptr;
};
