#pragma once

#include <string>

namespace terraport::tools {

/// Counts cases, and prints `N passed, N failed` at the end.
class Tally {
 public:
  /// Count a case; an empty `failure` passes.
  void add(const std::string& name, const std::string& failure);
  /// Name a case that this client does not take part in.
  void decline(const std::string& name, const std::string& reason);
  /// Print the totals; returns the exit code.
  int finish() const;

 private:
  int passed_ = 0;
  int failed_ = 0;
};

}  // namespace terraport::tools
