#include "WireCodec.h"

#include "Msgpack.h"
#include "Terraport/Transport.h"
#include "Utf8.h"
#include "WireRead.h"
#include "WireWrite.h"

#include <algorithm>
#include <utility>

namespace terraport {

namespace {

constexpr std::size_t kLongestType = 64;
/// Values of a server's message: each takes 24 bytes of memory. What the protocol has needs a few thousand.
constexpr std::uint32_t kMaxValues = 1u << 20;

void malformed(const std::string& text, DecodeError& error) {
  error = DecodeError{};
  error.code = "malformed";
  error.message = text;
}

/// Messages that are refused alone: they changed nothing, so the session goes on.
bool isRefusedAlone(std::string_view type) {
  return type == "aim" || type == "land" || type == "pick" || type == "join" || type == "gather";
}

/// Whether a message has a number of this name; asked of its type.
struct HasField {
  std::string_view fieldName;
  bool isPresent = false;

  template <typename Value, typename Kind>
  bool field(const char* name, const Value&, const Kind&) {
    isPresent = isPresent || fieldName == name;
    return true;
  }
};

/// A refused message's number for the answer, where it has one that is in range.
template <typename Message>
std::optional<std::uint32_t> numberOf(const char* name, const JsonValue& root) {
  const Message none{};
  HasField has{name};
  FieldsOf<Message>::visit(has, none);
  const std::optional<std::int64_t> value = root.member(name).integer();
  if (!has.isPresent || !value || *value < 0 || *value > 0xFFFFFFFF) return std::nullopt;
  return static_cast<std::uint32_t>(*value);
}

/// Read a message of one type; false where it is refused.
template <typename Message>
bool readMessage(const JsonValue& root, Message& into, DecodeError& error) {
  Refusal refusal;
  if (readFields(root, into, refusal) && checkRules(into, refusal)) return true;
  error = DecodeError{};
  error.code = "invalid_field";
  error.messageType = FieldsOf<Message>::kType;
  error.field = refusal.path;
  error.message = error.messageType + "." + refusal.path + ": " + refusal.text;
  error.isFatal = !isRefusedAlone(error.messageType);
  error.generation = numberOf<Message>("generation", root);
  error.request = numberOf<Message>("request", root);
  return false;
}

/// Try the alternatives of a variant from `Index` on by their types. The first is UnknownMessage.
template <std::size_t Index, typename Variant>
bool readNamed(std::string_view type, const JsonValue& root, Variant& into, DecodeError& error) {
  if constexpr (Index == std::variant_size_v<Variant>) {
    // At most so many code points: what does not begin one belongs to the one before.
    std::size_t end = 0;
    for (std::size_t count = 0; end < type.size(); ++end) {
      count += (static_cast<unsigned char>(type[end]) & 0xC0) == 0x80 ? 0 : 1;
      if (count > kLongestType) break;
    }
    into.template emplace<0>(UnknownMessage{std::string(type.substr(0, end))});
    return true;
  } else {
    using Message = std::variant_alternative_t<Index, Variant>;
    if (type != FieldsOf<Message>::kType) return readNamed<Index + 1>(type, root, into, error);
    return readMessage(root, into.template emplace<Index>(), error);
  }
}

constexpr std::size_t mostBytes(const ClientMessage*) {
  return limits::kMaxClientMessageBytes;
}
constexpr std::size_t mostBytes(const ServerMessage*) {
  return limits::kMaxServerMessageBytes;
}

constexpr std::uint32_t mostValues(const ClientMessage*) {
  return limits::kMaxClientValues;
}
constexpr std::uint32_t mostValues(const ServerMessage*) {
  return kMaxValues;
}

struct Encoder {
  EncodedMessage& into;

  Status operator()(const UnknownMessage& message) const {
    return Status::failed("invalid_field", shortened(message.type) + " is no message of the protocol");
  }

  template <typename Message>
  Status operator()(const Message& message) const {
    Refusal refusal;
    CheckPass checks{refusal};
    if (!FieldsOf<Message>::visit(checks, message) || !checkRules(message, refusal)) {
      return Status::failed("invalid_field", std::string(FieldsOf<Message>::kType) + "." + refusal.path + ": " + refusal.text);
    }
    into.bytes.clear();
    MsgpackWriter writer(into.bytes);
    WritePass{writer, into.bytes}.fieldsOf(message, true);
    return Status::ok();
  }
};

struct Checker {
  Status operator()(const UnknownMessage&) const { return Status::failed("invalid_field", "no message of the protocol"); }

  template <typename Message>
  Status operator()(const Message& message) const {
    Refusal refusal;
    CheckPass checks{refusal};
    if (FieldsOf<Message>::visit(checks, message) && checkRules(message, refusal)) return Status::ok();
    return Status::failed("invalid_field", std::string(FieldsOf<Message>::kType) + "." + refusal.path + ": " + refusal.text);
  }
};

struct TypeName {
  const char* operator()(const UnknownMessage& message) const { return message.type.c_str(); }

  template <typename Message>
  const char* operator()(const Message&) const {
    return FieldsOf<Message>::kType;
  }
};

}  // namespace

const char* typeOf(const ClientMessage& message) {
  return std::visit(TypeName{}, message);
}
const char* typeOf(const ServerMessage& message) {
  return std::visit(TypeName{}, message);
}

Status encodeMessage(const ClientMessage& message, EncodedMessage& into) {
  return std::visit(Encoder{into}, message);
}

Status encodeMessage(const ServerMessage& message, EncodedMessage& into) {
  return std::visit(Encoder{into}, message);
}

Status checkMessage(const ClientMessage& message) {
  return std::visit(Checker{}, message);
}

template <typename Message>
bool MessageReader::readAny(ByteSpan data, std::size_t maxBytes, Message& into, DecodeError& error) {
  const std::size_t limit = std::min(maxBytes, mostBytes(&into));
  if (data.size > limit) {
    malformed("got a message of " + std::to_string(data.size) + " bytes, expected at most " + std::to_string(limit), error);
    error.code = "too_large";
    return false;
  }
  JsonLimits read;
  read.maxBytes = limit;
  read.maxDepth = limits::kMaxDepth;
  read.maxValues = mostValues(&into);
  const Status status = readMsgpack(data, read, document_);
  if (!status.isOk()) {
    malformed(status.message() + (status.offset() < 0 ? "" : " (at byte " + std::to_string(status.offset()) + ")"), error);
    return false;
  }
  const JsonValue root = document_.root();
  const std::optional<std::string_view> type = root.member("type").text();
  if (!type) {
    malformed("got no map with a type that is text", error);
    return false;
  }
  return readNamed<1>(*type, root, into, error);
}

bool MessageReader::read(ByteSpan data, ClientMessage& into, DecodeError& error, std::size_t maxBytes) {
  return readAny(data, maxBytes, into, error);
}

bool MessageReader::read(ByteSpan data, ServerMessage& into, DecodeError& error, std::size_t maxBytes) {
  return readAny(data, maxBytes, into, error);
}

std::string tokenSubprotocol(const std::string& token) {
  static const char letters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_";
  std::string name = "terraport.token.";
  std::uint32_t bits = 0;
  unsigned count = 0;
  for (const char letter : token) {
    bits = (bits << 8) | static_cast<unsigned char>(letter);
    for (count += 8; count >= 6; count -= 6) name.push_back(letters[(bits >> (count - 6)) & 0x3F]);
  }
  if (count > 0) name.push_back(letters[(bits << (6 - count)) & 0x3F]);
  return name;
}

}  // namespace terraport
