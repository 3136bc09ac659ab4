// Tokens of a session that may outlive them.
#pragma once

#include <functional>
#include <string>
#include <utility>

namespace terraport {

/// Gives the token of each connection, and knows when another attempt is worth while.
class Access {
 public:
  Access(std::string token, std::function<std::string()> provider) : token_(std::move(token)), provider_(std::move(provider)) {}

  /// The present token; empty for none.
  const std::string& show() {
    shown_ = provider_ ? provider_() : token_;
    return shown_;
  }

  /// Whether there is another token than the one shown last, which was refused.
  bool hasNewer() const { return provider_ && provider_() != shown_; }

  /// Show this token from now on, asking nobody; whether it is another one. An empty one changes nothing.
  bool replace(const std::string& token) {
    if (token.empty() || token == shown_) return false;
    token_ = token;
    provider_ = nullptr;
    return true;
  }

 private:
  std::string token_;
  std::function<std::string()> provider_;
  std::string shown_;
};

}  // namespace terraport
