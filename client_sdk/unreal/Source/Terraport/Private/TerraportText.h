#pragma once

#include "CoreMinimal.h"

#include <cstdint>
#include <string>
#include <vector>

/** Text of the core (UTF-8) and of the engine. */
namespace TerraportText
{
inline FString FromUtf8(const std::string& Text)
{
	return FString(UTF8_TO_TCHAR(Text.c_str()));
}

inline std::string ToUtf8(const FString& Text)
{
	return std::string(TCHAR_TO_UTF8(*Text));
}
} // namespace TerraportText
