#pragma once

#include "IWebSocket.h"
#include "Modules/ModuleManager.h"

class FWebSocketsModule : public IModuleInterface {
 public:
  virtual TSharedRef<IWebSocket> CreateWebSocket(const FString& Url, const TArray<FString>& Protocols,
      const TMap<FString, FString>& UpgradeHeaders = TMap<FString, FString>()) = 0;
  static inline FWebSocketsModule* Stub = nullptr;
};
