// The core's HTTP on the engine's HTTPClient.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>

#include "Godot.h"
#include "Terraport/Http.h"

namespace terraport::godot {

/// Requests, one connection each, polled. Redirects are not followed. One thread, which may be any.
class HttpGets final : public Http {
 public:
  std::uint64_t get(const std::string& url, const std::string& bearerToken, std::size_t maxBytes) override;
  bool poll(std::uint64_t request, HttpAnswer& answer) override;
  std::uint64_t receivedBytes(std::uint64_t request) const override;
  void cancel(std::uint64_t request) override;

 private:
  struct Exchange {
    Variant client;
    std::string path;
    std::string token;
    std::size_t maxBytes = 0;
    bool isAsked = false;
    bool isOver = false;
    HttpAnswer answer;

    void step();
    void read();
    void fail(const std::string& reason);
  };

  std::map<std::uint64_t, Exchange> exchanges_;
  std::uint64_t last_ = 0;
};

}  // namespace terraport::godot
