// What we use of GDNative's C interface, Godot 3.2 and later 3.x, written from its documentation (modules/gdnative in the
// engine's sources, gdnative_api.json): a table of functions whose order never changes within version 1.0. Neither Debian nor a
// package registry installs the engine's own headers.
#pragma once

#include <cstddef>
#include <cstdint>

namespace terraport::godot::abi {

// Opaque values of the engine. Arrays of bytes, as there: that decides how a C function returns them.
struct Variant {
  alignas(8) std::uint8_t bytes[24];
};
struct Text {
  std::uint8_t bytes[8];
};
struct Utf8 {
  std::uint8_t bytes[8];
};
struct Array {
  std::uint8_t bytes[8];
};
struct Dictionary {
  std::uint8_t bytes[8];
};
struct PoolArray {
  std::uint8_t bytes[8];
};
struct Vector3 {
  std::uint8_t bytes[12];
};

using Object = void;
using MethodBind = void;
using PoolAccess = void;

struct Version {
  unsigned int major;
  unsigned int minor;
};

/// Head of every table.
struct Table {
  unsigned int type;
  Version version;
  const Table* next;
};

/// Kinds of tables: the core's, and that of scripts in native code.
constexpr unsigned int kTypeCore = 0;
constexpr unsigned int kTypeNativeScript = 1;

using Function = void (*)();

/// The core's table, version 1.0: 744 functions.
struct CoreTable {
  Table head;
  unsigned int extensionCount;
  const Table** extensions;
  Function functions[744];
};

struct NativeScriptTable {
  Table head;
  Function functions[6];
};

/// Places of functions in CoreTable.
enum Slot : std::size_t {
  kByteArrayNew = 155,
  kByteArrayResize = 164,
  kByteArrayRead = 165,
  kByteArrayWrite = 166,
  kByteArraySize = 169,
  kByteArrayDestroy = 170,
  kIntArrayNew = 171,
  kIntArrayResize = 180,
  kIntArrayWrite = 182,
  kIntArrayDestroy = 186,
  kStringArrayNew = 203,
  kStringArrayAppend = 206,
  kStringArrayDestroy = 218,
  kVector2ArrayNew = 219,
  kVector2ArrayResize = 228,
  kVector2ArrayWrite = 230,
  kVector2ArrayDestroy = 234,
  kVector3ArrayNew = 235,
  kVector3ArrayResize = 244,
  kVector3ArrayWrite = 246,
  kVector3ArrayDestroy = 250,
  kColorArrayNew = 251,
  kColorArrayResize = 260,
  kColorArrayWrite = 262,
  kColorArrayDestroy = 266,
  kByteReadPointer = 268,
  kByteReadDestroy = 270,
  kByteWritePointer = 296,
  kByteWriteDestroy = 298,
  kIntWritePointer = 300,
  kIntWriteDestroy = 302,
  kVector2WritePointer = 312,
  kVector2WriteDestroy = 314,
  kVector3WritePointer = 316,
  kVector3WriteDestroy = 318,
  kColorWritePointer = 320,
  kColorWriteDestroy = 322,
  kArrayNew = 323,
  kArrayAppend = 336,
  kArrayDestroy = 361,
  kDictionaryNew = 362,
  kDictionaryDestroy = 364,
  kDictionarySet = 375,
  kVariantType = 507,
  kVariantCopy = 508,
  kVariantNil = 509,
  kVariantFromBool = 510,
  kVariantFromInt = 512,
  kVariantFromReal = 513,
  kVariantFromString = 514,
  kVariantFromVector3 = 517,
  kVariantFromObject = 527,
  kVariantFromDictionary = 528,
  kVariantFromArray = 529,
  kVariantFromByteArray = 530,
  kVariantFromIntArray = 531,
  kVariantFromStringArray = 533,
  kVariantFromVector2Array = 534,
  kVariantFromVector3Array = 535,
  kVariantFromColorArray = 536,
  kVariantToBool = 537,
  kVariantToInt = 539,
  kVariantToReal = 540,
  kVariantToString = 541,
  kVariantToVector3 = 544,
  kVariantToObject = 554,
  kVariantToByteArray = 557,
  kVariantDestroy = 570,
  kUtf8Length = 571,
  kUtf8Data = 572,
  kUtf8Destroy = 573,
  kStringNew = 574,
  kStringToUtf8 = 678,
  kStringParseUtf8 = 680,
  kStringDestroy = 721,
  kGlobalSingleton = 731,
  kMethodBind = 732,
  kMethodCall = 734,
  kClassConstructor = 735,
  kPrintError = 741,
};

/// Places in NativeScriptTable.
enum ScriptSlot : std::size_t { kRegisterClass = 0, kRegisterMethod = 2 };

/// What `godot_gdnative_init` is given.
struct InitOptions {
  bool inEditor;
  std::uint64_t coreApiHash;
  std::uint64_t editorApiHash;
  std::uint64_t noApiHash;
  void (*reportVersionMismatch)(const Object*, const char*, Version, Version);
  void (*reportLoadingError)(const Object*, const char*);
  Object* library;
  const CoreTable* core;
  const Text* libraryPath;
};

struct CallError {
  int error;
  int argument;
  int expected;
};

struct CreateFunction {
  void* (*create)(Object*, void*);
  void* data;
  void (*freeData)(void*);
};

struct DestroyFunction {
  void (*destroy)(Object*, void*, void*);
  void* data;
  void (*freeData)(void*);
};

/// Called with the instance, `data`, what `create` gave, and the arguments.
struct MethodFunction {
  Variant (*method)(Object*, void*, void*, int, Variant**);
  void* data;
  void (*freeData)(void*);
};

}  // namespace terraport::godot::abi
