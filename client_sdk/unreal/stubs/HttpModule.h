#pragma once

#include "Interfaces/IHttpRequest.h"
#include "Modules/ModuleManager.h"

#include <functional>

/// Requests are made by whatever a test sets.
class FHttpModule : public IModuleInterface {
 public:
  static FHttpModule& Get() {
    static FHttpModule Module;
    return Module;
  }
  TSharedRef<IHttpRequest, ESPMode::ThreadSafe> CreateRequest() { return StubMake(); }
  std::function<TSharedRef<IHttpRequest, ESPMode::ThreadSafe>()> StubMake;
};
