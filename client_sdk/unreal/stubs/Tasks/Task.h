#pragma once

#include "CoreMinimal.h"

#include <thread>

namespace UE::Tasks {
enum class ETaskPriority : int8 { Normal, BackgroundNormal };

/// A thread that nobody waits for, as a launched task.
template <typename Body>
void Launch(const TCHAR*, Body&& Work, ETaskPriority = ETaskPriority::Normal) {
  std::thread(std::forward<Body>(Work)).detach();
}
} // namespace UE::Tasks
