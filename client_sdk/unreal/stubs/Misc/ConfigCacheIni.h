#pragma once

#include "CoreMinimal.h"

#include <map>

/// One ini file in memory; a test fills it.
class FConfigCacheIni {
 public:
  bool GetDouble(const TCHAR* Section, const TCHAR* Key, double& Value, const FString&) {
    return Find(StubDoubles, Section, Key, Value);
  }
  bool GetBool(const TCHAR* Section, const TCHAR* Key, bool& Value, const FString&) {
    return Find(StubBools, Section, Key, Value);
  }
  void SetDouble(const TCHAR* Section, const TCHAR* Key, double Value, const FString&) {
    StubDoubles[StubName(Section, Key)] = Value;
  }
  void SetBool(const TCHAR* Section, const TCHAR* Key, bool Value, const FString&) {
    StubBools[StubName(Section, Key)] = Value;
  }
  std::map<std::u16string, double> StubDoubles;
  std::map<std::u16string, bool> StubBools;

 private:
  static std::u16string StubName(const TCHAR* Section, const TCHAR* Key) { return std::u16string(Section) + u"/" + Key; }
  template <typename T>
  static bool Find(const std::map<std::u16string, T>& All, const TCHAR* Section, const TCHAR* Key, T& Value) {
    const auto Entry = All.find(StubName(Section, Key));
    if (Entry == All.end()) return false;
    Value = Entry->second;
    return true;
  }
};

inline FConfigCacheIni StubConfig;
inline FConfigCacheIni* GConfig = &StubConfig;
inline FString GEngineIni;
