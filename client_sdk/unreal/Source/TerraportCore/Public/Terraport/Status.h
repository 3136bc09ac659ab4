// How the core says that something went wrong: as a value. It throws nothing and ends no program, whatever the input.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

namespace terraport {

/// Whether something was done; if not, why.
///
/// The code is for programs: an error code of the wire protocol, or one of `damaged` (bytes that are not what they should be),
/// `unsupported_version`, `invalid_url`, `invalid_argument`, `unreachable`, `refused`, `several_scenes`, `out_of_memory`. The
/// message is for people: what was received, what was expected, what to do. A success costs no allocation.
class [[nodiscard]] Status {
 public:
  /// Success.
  Status() = default;

  /// Success.
  static Status ok() { return {}; }

  /// A failure. `code` must not be empty. `offset` is the byte at which it was noticed, -1 where none is known.
  static Status failed(std::string code, std::string message, std::int64_t offset = -1) {
    Status status;
    status.code_ = std::move(code);
    status.message_ = std::move(message);
    status.offset_ = offset;
    return status;
  }

  /// Bytes that are not what they should be.
  static Status damaged(std::string message, std::int64_t offset = -1) { return failed("damaged", std::move(message), offset); }

  bool isOk() const { return code_.empty(); }
  /// Empty for success.
  const std::string& code() const { return code_; }
  /// Empty for success.
  const std::string& message() const { return message_; }
  /// Byte at which it was noticed, -1 where none is known.
  std::int64_t offset() const { return offset_; }

  /// The message, and the offset where one is known.
  std::string text() const { return offset_ < 0 ? message_ : message_ + " (payload offset " + std::to_string(offset_) + ")"; }

 private:
  std::string code_;
  std::string message_;
  std::int64_t offset_ = -1;
};

/// A value, or why there is none.
template <typename T>
class [[nodiscard]] Result {
 public:
  Result(T value) : value_(std::move(value)) {}  // Not explicit: a value is a result,
  /// `status` must be a failure.
  Result(Status status) : status_(std::move(status)) {}  // and so is a failure.

  bool isOk() const { return value_.has_value(); }
  const Status& status() const { return status_; }

  /// Only where isOk().
  T& value() { return *value_; }
  const T& value() const { return *value_; }
  /// The value, moved out; only where isOk().
  T take() { return std::move(*value_); }

 private:
  std::optional<T> value_;
  Status status_;
};

}  // namespace terraport

/// Leave the function with the status of an expression that failed.
#define TERRAPORT_RETURN_IF_ERROR(expression)            \
  do {                                                   \
    ::terraport::Status terraportStatus_ = (expression); \
    if (!terraportStatus_.isOk()) {                      \
      return terraportStatus_;                           \
    }                                                    \
  } while (false)
