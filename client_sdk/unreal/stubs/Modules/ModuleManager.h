#pragma once

#include "CoreMinimal.h"

#include <algorithm>
#include <functional>
#include <vector>

class IModuleInterface {
 public:
  virtual ~IModuleInterface() = default;
  virtual void StartupModule() {}
};

class FDefaultModuleImpl : public IModuleInterface {};

/// Modules of the stubs are set by tests.
class FModuleManager {
 public:
  static FModuleManager& Get() {
    static FModuleManager Manager;
    return Manager;
  }
  bool IsModuleLoaded(const FName Name) const {
    return std::find(StubLoaded.begin(), StubLoaded.end(), Name) != StubLoaded.end();
  }
  IModuleInterface* LoadModule(const FName& Name) {
    if (!IsModuleLoaded(Name)) {
      StubLoaded.push_back(Name);
      if (StubOnLoad) StubOnLoad(Name);
    }
    return nullptr;
  }
  template <typename T>
  static T* GetModulePtr(const FName&) {
    return T::Stub;
  }
  template <typename T>
  static T& LoadModuleChecked(const FName& Name) {
    Get().LoadModule(Name);
    return *T::Stub;
  }
  std::vector<FName> StubLoaded;
  /// Called where a module is loaded, as its own start is in the engine.
  std::function<void(const FName&)> StubOnLoad;
};

/// A test declares the function, and starts the module as the engine does.
#define IMPLEMENT_MODULE(Class, Name)    \
  IModuleInterface& StubModule##Name();  \
  IModuleInterface& StubModule##Name() { \
    static Class Module;                 \
    return Module;                       \
  }
