#pragma once

#include <map>

#include "Terraport/Http.h"

namespace terraport::tools {

/// GET over a plain socket, one after the other, while `get` is called: enough for a program that tests the loader, and for
/// nothing else. http alone, answers with a Content-Length or until the connection ends.
class PlainHttp final : public Http {
 public:
  std::uint64_t get(const std::string& url, const std::string& bearerToken, std::size_t maxBytes) override;
  bool poll(std::uint64_t request, HttpAnswer& answer) override;
  void cancel(std::uint64_t request) override;

 private:
  std::map<std::uint64_t, HttpAnswer> answers_;
  std::uint64_t last_ = 0;
};

}  // namespace terraport::tools
