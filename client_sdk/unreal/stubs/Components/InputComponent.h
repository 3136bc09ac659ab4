#pragma once

#include "Components/ActorComponent.h"

struct FKey;

enum EInputEvent { IE_Pressed, IE_Released };

class UInputComponent : public UActorComponent {
 public:
  using Super = UInputComponent;
  template <typename T>
  void BindKey(const FKey&, EInputEvent, T*, void (T::*)()) {}
  template <typename T, typename Method>
  void BindAxisKey(const FKey&, T*, Method) {}
};
