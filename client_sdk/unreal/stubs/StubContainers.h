#pragma once

#include "StubTypes.h"

#include <map>
#include <optional>
#include <set>
#include <vector>

template <typename T, typename Size = int32>
class TStubArray {
 public:
  void Reserve(Size Count) { Items.reserve(std::size_t(Count)); }
  void Reset() { Items.clear(); }
  void SetNumUninitialized(Size Count) { Items.resize(std::size_t(Count)); }
  void SetNum(Size Count) { Items.resize(std::size_t(Count)); }
  Size Add(const T& Item) {
    Items.push_back(Item);
    return Size(Items.size()) - 1;
  }
  Size Num() const { return Size(Items.size()); }
  T* GetData() { return Items.data(); }
  const T* GetData() const { return Items.data(); }
  T& operator[](Size At) { return Items.at(std::size_t(At)); }
  const T& operator[](Size At) const { return Items.at(std::size_t(At)); }
  auto begin() { return Items.begin(); }
  auto end() { return Items.end(); }
  auto begin() const { return Items.begin(); }
  auto end() const { return Items.end(); }

 private:
  std::vector<T> Items;
};

template <typename T>
using TArray = TStubArray<T, int32>;
template <typename T>
using TArray64 = TStubArray<T, int64>;

/// Owns its items; `Add` takes a pointer.
template <typename T>
class TIndirectArray {
 public:
  void Add(T* Item) { Items.emplace_back(Item); }
  int32 Num() const { return int32(Items.size()); }
  T& operator[](int32 At) { return *Items.at(std::size_t(At)); }

 private:
  std::vector<std::unique_ptr<T>> Items;
};

template <typename Key, typename Value>
class TMap {
 public:
  Value& Add(const Key& At, const Value& Item) { return Items[At] = Item; }
  const Value* Find(const Key& At) const {
    const auto Entry = Items.find(At);
    return Entry == Items.end() ? nullptr : &Entry->second;
  }
  int32 Num() const { return int32(Items.size()); }

 private:
  std::map<Key, Value> Items;
};

template <typename T>
class TSet {
 public:
  void Add(const T& Item) { Items.insert(Item); }
  int32 Remove(const T& Item) { return int32(Items.erase(Item)); }
  int32 Num() const { return int32(Items.size()); }

 private:
  std::set<T> Items;
};

template <typename T>
class TOptional {
 public:
  TOptional() = default;
  TOptional& operator=(const T& Item) {
    StubValue = Item;
    return *this;
  }
  bool IsSet() const { return StubValue.has_value(); }
  T* operator->() { return &*StubValue; }
  T& operator*() { return *StubValue; }
  void Reset() { StubValue.reset(); }

 private:
  std::optional<T> StubValue;
};

template <typename T>
class TUniquePtr {
 public:
  TUniquePtr() = default;
  TUniquePtr(std::unique_ptr<T> Item) : StubObject(std::move(Item)) {}
  template <typename Other>
  TUniquePtr(TUniquePtr<Other>&& Item) : StubObject(std::move(Item.StubObject)) {}
  bool IsValid() const { return StubObject != nullptr; }
  void Reset() { StubObject.reset(); }
  T& operator*() const { return *StubObject; }
  T* operator->() const { return StubObject.get(); }
  T* Get() const { return StubObject.get(); }
  std::unique_ptr<T> StubObject;
};
template <typename T, typename... Args>
TUniquePtr<T> MakeUnique(Args&&... Of) {
  return TUniquePtr<T>(std::make_unique<T>(std::forward<Args>(Of)...));
}

template <typename T, ESPMode Mode = ESPMode::ThreadSafe>
class TSharedRef;

template <typename T, ESPMode Mode = ESPMode::ThreadSafe>
class TSharedPtr {
 public:
  TSharedPtr() = default;
  explicit TSharedPtr(std::shared_ptr<T> Item) : StubObject(std::move(Item)) {}
  template <typename Other>
  TSharedPtr(const TSharedPtr<Other, Mode>& Item) : StubObject(Item.StubObject) {}
  template <typename Other>
  TSharedPtr(const TSharedRef<Other, Mode>& Item) : StubObject(Item.StubObject) {}
  bool IsValid() const { return StubObject != nullptr; }
  void Reset() { StubObject.reset(); }
  T* Get() const { return StubObject.get(); }
  T* operator->() const { return StubObject.get(); }
  T& operator*() const { return *StubObject; }
  TSharedRef<T, Mode> ToSharedRef() const { return TSharedRef<T, Mode>(StubObject); }
  std::shared_ptr<T> StubObject;
};

/// Never null.
template <typename T, ESPMode Mode>
class TSharedRef {
 public:
  explicit TSharedRef(std::shared_ptr<T> Item) : StubObject(std::move(Item)) {}
  template <typename Other>
  TSharedRef(const TSharedRef<Other, Mode>& Item) : StubObject(Item.StubObject) {}
  T* operator->() const { return StubObject.get(); }
  T& operator*() const { return *StubObject; }
  std::shared_ptr<T> StubObject;
};

template <typename T, ESPMode Mode = ESPMode::ThreadSafe, typename... Args>
TSharedRef<T, Mode> MakeShared(Args&&... Of) {
  return TSharedRef<T, Mode>(std::make_shared<T>(std::forward<Args>(Of)...));
}
