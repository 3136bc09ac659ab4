#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

using int8 = std::int8_t;
using int16 = std::int16_t;
using int32 = std::int32_t;
using int64 = long long;
using uint8 = std::uint8_t;
using uint16 = std::uint16_t;
using uint32 = std::uint32_t;
using uint64 = unsigned long long;
using SIZE_T = std::size_t;
using TCHAR = char16_t;

#define TEXT(Literal) u##Literal
#define TERRAPORT_API
#define TERRAPORTSAMPLE_API

enum EForceInit { ForceInit };

/// The engine's words for std::move.
template <typename T>
std::remove_reference_t<T>&& MoveTemp(T&& Value) {
  return static_cast<std::remove_reference_t<T>&&>(Value);
}

enum class ESPMode : uint8 { NotThreadSafe, ThreadSafe };

inline uint64 GFrameCounter = 0;

struct FMemory {
  static void* Memcpy(void* To, const void* From, SIZE_T Bytes) { return std::memcpy(To, From, Bytes); }
};

struct FMath {
  template <typename T>
  static T Clamp(T Value, T Least, T Most) {
    return Value < Least ? Least : (Value > Most ? Most : Value);
  }
  template <typename T>
  static T Max(T A, T B) {
    return A < B ? B : A;
  }
  template <typename T>
  static T Abs(T Value) {
    return Value < T(0) ? -Value : Value;
  }
};

// Strings: UTF-16 as on every platform of the engine; only what is converted and compared.
class FString {
 public:
  FString() = default;
  FString(const TCHAR* Text) : Units(Text) {}
  const TCHAR* operator*() const { return Units.c_str(); }
  bool IsEmpty() const { return Units.empty(); }
  int32 Len() const { return int32(Units.size()); }
  bool operator==(const FString& Other) const { return Units == Other.Units; }
  bool operator<(const FString& Other) const { return Units < Other.Units; }
  friend FString operator/(const FString& Folder, const TCHAR* Name) { return FString((Folder.Units + u"/" + Name).c_str()); }
  friend FString operator+(const TCHAR* Left, const FString& Right) {
    FString Out(Left);
    Out.Units += Right.Units;
    return Out;
  }

 private:
  std::u16string Units;
};

class FName {
 public:
  FName() = default;
  FName(const TCHAR* InText) : Text(InText) {}
  bool operator==(const FName& Other) const { return Text == Other.Text; }

 private:
  std::u16string Text;
};
inline const FName NAME_None;

namespace StubText {
std::string Utf8Of(const TCHAR* Text);
std::u16string Utf16Of(const char* Text);
struct FUtf8 {
  std::string Bytes;
  operator const char*() const { return Bytes.c_str(); }
};
struct FUtf16 {
  std::u16string Units;
  operator const TCHAR*() const { return Units.c_str(); }
};
} // namespace StubText

#define TCHAR_TO_UTF8(Text) static_cast<const char*>(StubText::FUtf8{StubText::Utf8Of(Text)})
#define UTF8_TO_TCHAR(Text) static_cast<const TCHAR*>(StubText::FUtf16{StubText::Utf16Of(Text)})

/// UTF-8 and UTF-16, for well-formed text.
inline std::string StubText::Utf8Of(const TCHAR* Text) {
  std::string Out;
  for (; *Text != 0; ++Text) {
    char32_t Point = *Text;
    if (Point >= 0xD800 && Point < 0xDC00 && Text[1] != 0) {
      Point = 0x10000 + ((Point - 0xD800) << 10) + (Text[1] - 0xDC00u);
      ++Text;
    }
    if (Point < 0x80) {
      Out += char(Point);
      continue;
    }
    const int More = Point < 0x800 ? 1 : (Point < 0x10000 ? 2 : 3);
    const int Lead[] = {0, 0xC0, 0xE0, 0xF0};
    Out += char(Lead[More] | int(Point >> (6 * More)));
    for (int At = More - 1; At >= 0; --At) Out += char(0x80 | int((Point >> (6 * At)) & 0x3F));
  }
  return Out;
}

inline std::u16string StubText::Utf16Of(const char* Text) {
  std::u16string Out;
  for (const unsigned char* Byte = reinterpret_cast<const unsigned char*>(Text); *Byte != 0;) {
    const int More = *Byte < 0x80 ? 0 : (*Byte < 0xE0 ? 1 : (*Byte < 0xF0 ? 2 : 3));
    const int Mask[] = {0x7F, 0x1F, 0x0F, 0x07};
    char32_t Point = char32_t(*Byte & Mask[More]);
    ++Byte;
    for (int At = 0; At < More && *Byte != 0; ++At, ++Byte) Point = (Point << 6) | char32_t(*Byte & 0x3F);
    if (Point >= 0x10000) {
      Out += char16_t(0xD800 + ((Point - 0x10000) >> 10));
      Out += char16_t(0xDC00 + ((Point - 0x10000) & 0x3FF));
    } else {
      Out += char16_t(Point);
    }
  }
  return Out;
}

#define UE_LOG(Category, Verbosity, Format, ...) StubLog(#Verbosity, Format, ##__VA_ARGS__)
#define DECLARE_LOG_CATEGORY_EXTERN(Name, Default, All) \
  struct FStub##Name {};                                \
  extern FStub##Name Name
#define DEFINE_LOG_CATEGORY(Name) FStub##Name Name;
/// Warnings since the start, their formats.
inline std::vector<std::u16string> StubWarnings;
template <typename... Parts>
void StubLog(const std::string& Verbosity, const TCHAR* Format, const Parts&...) {
  if (Verbosity == "Warning") StubWarnings.emplace_back(Format);
}
