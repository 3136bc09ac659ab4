#pragma once

#include "StubContainers.h"
#include "StubMath.h"
#include "StubTypes.h"

#include <functional>

// ---- reflection: the header tool's marks say nothing to a plain compiler

#define UCLASS(...)
#define USTRUCT(...)
#define UENUM(...)
#define UPROPERTY(...)
#define UFUNCTION(...)
#define GENERATED_BODY()
#define WITH_EDITOR 1

// ---- objects

enum EObjectFlags { RF_NoFlags = 0, RF_ClassDefaultObject = 0x10, RF_Transient = 0x40, RF_DuplicateTransient = 0x1000000 };
enum ELoadFlags { LOAD_None = 0, LOAD_Quiet = 0x2000, LOAD_NoWarn = 0x2 };
inline EObjectFlags operator|(EObjectFlags A, EObjectFlags B) {
  return EObjectFlags(int(A) | int(B));
}

class UObject {
 public:
  virtual ~UObject() = default;
  FString GetName() const { return FString(TEXT("Stub")); }
  virtual void BeginDestroy() {}
  /// No object of the stubs is its class's default.
  bool HasAnyFlags(EObjectFlags) const { return false; }
  bool IsUnreachable() const { return bStubUnreachable; }
  bool bStubDestroyed = false;
  bool bStubUnreachable = false;
};

inline bool IsValid(const UObject* Object) {
  return Object != nullptr && !Object->bStubDestroyed;
}

template <typename T>
class TObjectPtr {
 public:
  TObjectPtr() = default;
  TObjectPtr(T* InObject) : Object(InObject) {}
  T* Get() const { return Object; }
  operator T*() const { return Object; }
  T* operator->() const { return Object; }

 private:
  T* Object = nullptr;
};

/// Objects of the stubs live until the program ends: a collector is no part of what is tested.
template <typename T>
T* NewObject(UObject* = nullptr, FName = NAME_None, EObjectFlags = RF_NoFlags) {
  return new T();
}

template <typename T>
T* LoadObject(UObject*, const TCHAR*) {
  return nullptr;
}

// ---- delegates

template <typename... Args>
class TMulticastDelegate {
 public:
  template <typename Functor>
  void AddLambda(Functor&& Listener) {
    Listeners.push_back(std::forward<Functor>(Listener));
  }
  void Clear() { Listeners.clear(); }
  void Broadcast(Args... Of) const {
    const std::vector<std::function<void(Args...)>> Now = Listeners;
    for (const auto& Listener : Now) Listener(Of...);
  }

 private:
  std::vector<std::function<void(Args...)>> Listeners;
};

template <typename... Args>
class TDelegate {
 public:
  template <typename Functor>
  void BindLambda(Functor&& Listener) {
    Bound = std::forward<Functor>(Listener);
  }
  void Unbind() { Bound = nullptr; }
  bool ExecuteIfBound(Args... Of) const {
    if (Bound) Bound(Of...);
    return bool(Bound);
  }

 private:
  std::function<void(Args...)> Bound;
};

/// One that answers. The engine's is bound to a UFUNCTION by its name; here to a function.
template <typename Answer>
class TAnsweringDelegate {
 public:
  template <typename Functor>
  void BindLambda(Functor&& Listener) {
    Bound = std::forward<Functor>(Listener);
  }
  bool IsBound() const { return bool(Bound); }
  Answer Execute() const { return Bound(); }

 private:
  std::function<Answer()> Bound;
};

#define DECLARE_DYNAMIC_DELEGATE_RetVal(Answer, Name) using Name = TAnsweringDelegate<Answer>
#define DECLARE_DYNAMIC_MULTICAST_DELEGATE(Name) using Name = TMulticastDelegate<>
#define DECLARE_DYNAMIC_MULTICAST_DELEGATE_OneParam(Name, Type, Parameter) using Name = TMulticastDelegate<Type>
