#include "Backoff.h"

#include <algorithm>

namespace terraport {

double waitMs(int attempt, double chance) {
  constexpr double kFirstMs = 500;
  constexpr double kLongestMs = 30000;
  const double doubled = kFirstMs * static_cast<double>(1 << std::clamp(attempt, 0, 16));
  return std::min(kLongestMs, doubled) * (0.5 + 0.5 * chance);
}

}  // namespace terraport
