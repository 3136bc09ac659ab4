// Errors of the wire, and what a client makes of a close code (wire protocol, section 11).
#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace terraport {

/// What was received is not allowed.
struct DecodeError {
  /// `malformed`: bytes or text that are no message and no frame. `too_large`: beyond the limit of its direction.
  /// `invalid_field`: a known message with a field that is missing, mistyped or out of range.
  std::string code;
  /// False for messages that change nothing by being refused; else the connection cannot go on.
  bool isFatal = true;
  /// What was received and what was expected, for people.
  std::string message;
  /// For `invalid_field`: the type of the message, and the path of the field.
  std::string messageType;
  std::string field;
  std::optional<std::uint32_t> generation;
  std::optional<std::uint32_t> request;
};

/// What a client does after a close.
enum class AfterClose : std::uint8_t {
  Done,
  /// Connect again.
  Again,
  /// Ask for another token.
  Token,
  Stop,
};

/// What a client does after a connection was closed with this code; codes that are not known may pass, so `Again`.
AfterClose afterClose(int closeCode);

/// The error code that a close code stands for, where a close came without an `error` message; else "closed".
std::string codeOfClose(int closeCode);

constexpr int kCloseNormal = 1000;
constexpr int kCloseAbnormal = 1006;
constexpr int kCloseMalformed = 4400;
constexpr int kCloseUnauthorised = 4401;
constexpr int kCloseTimeout = 4408;

}  // namespace terraport
