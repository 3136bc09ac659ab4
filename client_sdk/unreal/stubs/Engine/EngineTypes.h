#pragma once

#include "CoreMinimal.h"

/// One of 32 types that a project names.
enum EObjectTypeQuery : int { ObjectTypeQuery1, ObjectTypeQuery2, ObjectTypeQuery3 };

template <typename Enum>
class TEnumAsByte {
 public:
  TEnumAsByte() = default;
  TEnumAsByte(Enum InValue) : Value(uint8(InValue)) {}
  operator Enum() const { return Enum(Value); }

 private:
  uint8 Value = 0;
};
