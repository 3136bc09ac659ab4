#pragma once

#include "CoreMinimal.h"

struct FKey {};

struct EKeys {
  static inline const FKey LeftMouseButton, RightMouseButton, MouseX, MouseY, Q, E;
};
