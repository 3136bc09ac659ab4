#pragma once

/// Unreal's build tool defines MODULE_API as one of these, and this header is where they get their meaning.
#define DLLEXPORT __attribute__((visibility("default")))
#define DLLIMPORT __attribute__((visibility("default")))
