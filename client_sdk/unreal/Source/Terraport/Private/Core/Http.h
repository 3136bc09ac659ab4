// The HTTP that the core needs of an engine.
#pragma once

#include <cstdint>
#include <string>

#include "Core/Basics.h"

namespace terraport {

struct HttpAnswer {
  /// HTTP status; 0 where no answer came.
  int status = 0;
  /// Why no answer came, for people.
  std::string reason;
  Bytes body;
  /// The body has more than `maxBytes`.
  bool isTooLarge = false;
};

/// Requests that are polled: nothing blocks, nothing calls back. One thread.
class Http {
 public:
  virtual ~Http() = default;
  /// Begin a GET. A token that is not empty goes into `Authorization: Bearer`. Returns a number above 0.
  virtual std::uint64_t get(const std::string& url, const std::string& token, std::size_t maxBytes) = 0;
  /// True once it is over, either way; the number is invalid then.
  virtual bool poll(std::uint64_t request, HttpAnswer& answer) = 0;
  /// Give up a request that is not over.
  virtual void cancel(std::uint64_t request) = 0;
};

}  // namespace terraport
