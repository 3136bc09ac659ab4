#pragma once

#include "CoreMinimal.h"
#include "Interfaces/IHttpResponse.h"
#include "Misc/EngineVersionComparison.h"

class IHttpRequest;
using FHttpRequestPtr = TSharedPtr<IHttpRequest, ESPMode::ThreadSafe>;
using FHttpRequestCompleteDelegate = TDelegate<FHttpRequestPtr, FHttpResponsePtr, bool>;
using FHttpRequestProgressDelegate64 = TDelegate<FHttpRequestPtr, uint64, uint64>;

class IHttpRequest {
 public:
  virtual ~IHttpRequest() = default;
  virtual void SetURL(const FString& Url) = 0;
  virtual void SetVerb(const FString& Verb) = 0;
  virtual void SetHeader(const FString& Name, const FString& Value) = 0;
  virtual bool ProcessRequest() = 0;
  virtual void CancelRequest() = 0;
  virtual FHttpRequestCompleteDelegate& OnProcessRequestComplete() = 0;
  virtual FHttpRequestProgressDelegate64& OnRequestProgress64() = 0;
};
