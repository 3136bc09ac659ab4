// The engine's values and methods, as C++: a value that owns, and calls by name that were looked up once.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "GodotAbi.h"
#include "Terraport/Types.h"

namespace terraport::godot {

/// Take the engine's table; once, before anything else here. False, with `missing` named, where this engine lacks a method.
bool begin(const abi::CoreTable& core, std::string& missing);

/// Into the engine's log, as an error.
void printError(const std::string& text);

/// A value of the engine. Copies share what is behind it.
class Variant {
 public:
  Variant();
  Variant(bool value);
  Variant(int value) : Variant(static_cast<std::int64_t>(value)) {}
  Variant(std::int64_t value);
  Variant(double value);
  Variant(const char* utf8) : Variant(std::string(utf8)) {}
  Variant(const std::string& utf8);
  Variant(const Vec3& vector);
  /// An object; counted where it is a Reference.
  static Variant of(abi::Object* object);
  /// Takes over what a call returned.
  explicit Variant(const abi::Variant& raw) : raw_(raw) {}

  Variant(const Variant& other);
  Variant(Variant&& other) noexcept;
  Variant& operator=(Variant other) noexcept {
    std::swap(raw_, other.raw_);
    return *this;
  }
  ~Variant();

  bool isNil() const;
  bool toBool() const;
  std::int64_t toInt() const;
  double toReal() const;
  std::string toText() const;
  Vec3 toVec3() const;
  abi::Object* toObject() const;
  std::vector<std::uint8_t> toBytes() const;

  const abi::Variant* raw() const { return &raw_; }
  /// Hand it over: this is nil afterwards.
  abi::Variant release();

 private:
  abi::Variant raw_;
};

/// A list that grows. Copies share.
class List {
 public:
  List();
  ~List();
  List(const List&) = delete;
  List& operator=(const List&) = delete;
  void add(const Variant& value);
  Variant variant() const;

 private:
  abi::Array raw_;
};

/// A dictionary with texts as keys.
class Dictionary {
 public:
  Dictionary();
  ~Dictionary();
  Dictionary(const Dictionary&) = delete;
  Dictionary& operator=(const Dictionary&) = delete;
  Dictionary& set(const char* key, const Variant& value);
  Variant variant() const;

 private:
  abi::Dictionary raw_;
};

/// Arrays of the engine, filled in place: `fill` is given as many entries as were asked for.
template <typename Entry, typename Fill>
Variant arrayOf(std::size_t count, Fill&& fill);

struct Float2 {
  float x, y;
};
struct Float3 {
  float x, y, z;
};
/// sRGB and alpha, 0 to 1.
struct Float4 {
  float r, g, b, a;
};

Variant stringArray(const std::vector<std::string>& texts);

/// A method of a class of the engine. Objects of this type are global: `begin` looks all of them up.
class Method {
 public:
  Method(const char* className, const char* name);

  template <typename... Arguments>
  Variant operator()(abi::Object* object, const Arguments&... arguments) const {
    const Variant values[sizeof...(Arguments) + 1] = {Variant(arguments)..., Variant()};
    const abi::Variant* pointers[sizeof...(Arguments) + 1];
    for (std::size_t at = 0; at < sizeof...(Arguments); ++at) pointers[at] = values[at].raw();
    return call(object, pointers, static_cast<int>(sizeof...(Arguments)));
  }
  template <typename... Arguments>
  Variant operator()(const Variant& object, const Arguments&... arguments) const {
    return (*this)(object.toObject(), arguments...);
  }

  const char* className() const { return className_; }
  const char* name() const { return name_; }
  bool lookUp();

 private:
  Variant call(abi::Object* object, const abi::Variant** arguments, int count) const;

  const char* className_;
  const char* name_;
  abi::MethodBind* bind_ = nullptr;
};

/// The one object of a class that has one.
abi::Object* singleton(const char* name);

/// A new object of a class that is a Reference.
Variant make(const char* className);

namespace detail {
/// Slots of one kind of array, and of the access to its memory.
struct PoolSlots {
  abi::Slot make, resize, write, pointer, endWrite, toVariant, destroy;
};
template <typename Entry>
PoolSlots poolSlots();
template <>
inline PoolSlots poolSlots<std::uint8_t>() {
  return {abi::kByteArrayNew, abi::kByteArrayResize, abi::kByteArrayWrite, abi::kByteWritePointer, abi::kByteWriteDestroy,
      abi::kVariantFromByteArray, abi::kByteArrayDestroy};
}
template <>
inline PoolSlots poolSlots<std::int32_t>() {
  return {abi::kIntArrayNew, abi::kIntArrayResize, abi::kIntArrayWrite, abi::kIntWritePointer, abi::kIntWriteDestroy,
      abi::kVariantFromIntArray, abi::kIntArrayDestroy};
}
template <>
inline PoolSlots poolSlots<Float2>() {
  return {abi::kVector2ArrayNew, abi::kVector2ArrayResize, abi::kVector2ArrayWrite, abi::kVector2WritePointer,
      abi::kVector2WriteDestroy, abi::kVariantFromVector2Array, abi::kVector2ArrayDestroy};
}
template <>
inline PoolSlots poolSlots<Float3>() {
  return {abi::kVector3ArrayNew, abi::kVector3ArrayResize, abi::kVector3ArrayWrite, abi::kVector3WritePointer,
      abi::kVector3WriteDestroy, abi::kVariantFromVector3Array, abi::kVector3ArrayDestroy};
}
template <>
inline PoolSlots poolSlots<Float4>() {
  return {abi::kColorArrayNew, abi::kColorArrayResize, abi::kColorArrayWrite, abi::kColorWritePointer, abi::kColorWriteDestroy,
      abi::kVariantFromColorArray, abi::kColorArrayDestroy};
}
/// An array of the engine while it is filled.
class PoolFilling {
 public:
  PoolFilling(const PoolSlots& slots, std::size_t count);
  ~PoolFilling();
  PoolFilling(const PoolFilling&) = delete;
  PoolFilling& operator=(const PoolFilling&) = delete;
  void* data() const { return data_; }
  /// Ends the filling.
  Variant variant();

 private:
  void end();
  PoolSlots slots_;
  abi::PoolArray raw_;
  abi::PoolAccess* access_ = nullptr;
  void* data_ = nullptr;
};
}  // namespace detail

template <typename Entry, typename Fill>
Variant arrayOf(std::size_t count, Fill&& fill) {
  detail::PoolFilling filling(detail::poolSlots<Entry>(), count);
  if (count > 0) fill(static_cast<Entry*>(filling.data()));
  return filling.variant();
}

}  // namespace terraport::godot
