// What the core needs of the HTTP of an engine.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "Terraport/Api.h"

namespace terraport {

/// The server's answer to a request, or why there is none.
struct HttpAnswer {
  /// HTTP status; 0 where no answer came.
  int status = 0;
  /// Why no answer came; for people.
  std::string reason;
  std::vector<std::uint8_t> body;
  /// The body has more than `maxBytes`; then `body` may be cut off anywhere.
  bool isTooLarge = false;
};

/// Requests that are asked about: nothing here blocks, and nothing calls back. One thread.
class TERRAPORTCORE_API Http {
 public:
  virtual ~Http() = default;

  /// Begin a GET of an http or https URL; a token that is not empty goes into `Authorization: Bearer`, to that server alone:
  /// redirects must not be followed with it. At most `maxBytes` of a body are kept. Returns a number that is not 0.
  virtual std::uint64_t get(const std::string& url, const std::string& bearerToken, std::size_t maxBytes) = 0;

  /// True once it is over, whichever way: the answer is moved out, and the number means nothing any more.
  virtual bool poll(std::uint64_t request, HttpAnswer& answer) = 0;

  /// Bytes of the body that have come so far.
  virtual std::uint64_t receivedBytes(std::uint64_t request) const {
    (void)request;
    return 0;
  }

  /// Give a request up that is not over; the number means nothing any more.
  virtual void cancel(std::uint64_t request) = 0;
};

}  // namespace terraport
