#include <cstdio>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "Frames.h"
#include "Msgpack.h"
#include "Terraport/Json.h"
#include "WireCodec.h"
#include "corpora.h"
#include "files.h"
#include "readable_form.h"
#include "tally.h"

namespace terraport::tools {
namespace {

std::string textOf(const JsonValue& value) {
  return std::string(value.text().value_or(""));
}

std::string errorDifference(const DecodeError& error, const JsonValue& expected) {
  if (!expected.exists()) {
    return "refused: " + error.message;
  }
  if (error.code != textOf(expected.member("code"))) {
    return "error " + error.code + ", expected " + textOf(expected.member("code"));
  }
  if (error.isFatal != expected.member("fatal").boolean()) {
    return "fatal or not";
  }
  if (error.field != textOf(expected.member("field"))) {
    return "field " + error.field + ", expected " + textOf(expected.member("field"));
  }
  const auto differs = [&expected](const char* name, const auto& actual) {
    const auto stated = expected.member(name).integer();
    return actual.has_value() != stated.has_value() || (stated && static_cast<std::int64_t>(*actual) != *stated);
  };
  return differs("generation", error.generation) ? "generation" : differs("request", error.request) ? "request" : "";
}

template <typename Message>
std::string messageDifference(ByteSpan data, const JsonValue& facts) {
  MessageReader reader;
  Message message;
  DecodeError error;
  if (!reader.read(data, message, error)) {
    return errorDifference(error, facts.member("error"));
  }
  if (facts.member("error").exists()) {
    return "was taken; expected the error " + textOf(facts.member("error").member("code"));
  }
  if (const auto* unknown = std::get_if<UnknownMessage>(&message)) {
    return unknown->type == textOf(facts.member("unknown")) ? "" : "unknown type " + unknown->type;
  }
  if (!facts.member("message").exists()) {
    return std::string("was taken as ") + typeOf(message) + "; expected an unknown type";
  }
  // What is written again is what the corpus states, number for number.
  EncodedMessage again;
  JsonDocument document;
  if (!encodeMessage(message, again).isOk() || !readMsgpack(again.view(), {}, document).isOk()) {
    return "cannot be written again";
  }
  if (!isAsStated(document.root(), facts.member("message"))) {
    return "is read as another message";
  }
  const bool isSame = again.bytes == std::string_view(reinterpret_cast<const char*>(data.data), data.size);
  const bool isCanonical = facts.member("canonical").boolean().value_or(false);
  return isSame == isCanonical ? ""
                               : std::string("encodes to ") + (isSame ? "the same" : "other") + " bytes, expected otherwise";
}

std::string frameDifference(ByteSpan data, const JsonValue& facts) {
  PayloadFrame frame;
  DecodeError error;
  if (!decodeFrame(data, frame, error)) {
    return errorDifference(error, facts.member("error"));
  }
  if (facts.member("error").exists()) {
    return "was taken; expected the error " + textOf(facts.member("error").member("code"));
  }
  const JsonValue expected = facts.member("frame");
  if (frame.unknownKind || expected.member("unknown_kind").exists()) {
    const auto kind = expected.member("unknown_kind").integer();
    return frame.unknownKind && kind == *frame.unknownKind ? "" : "of an unknown kind or not";
  }
  std::string hex;
  for (std::size_t at = 0; at < frame.chunk.size; ++at) {
    char digits[3];
    std::snprintf(digits, sizeof digits, "%02x", frame.chunk.data[at]);
    hex += digits;
  }
  const bool isSame = expected.member("generation").integer() == frame.generation &&
      expected.member("segment").integer() == frame.segment && expected.member("offset").integer() == frame.offset &&
      expected.member("total").integer() == frame.total && expected.member("last").boolean() == frame.isLast &&
      textOf(expected.member("chunk_hex")) == hex;
  return isSame ? "" : "is another frame";
}

/// What is wrong with a case; empty where it is as it should be.
std::string whyNot(const std::string& stem) {
  const std::vector<std::uint8_t> text = readFile(stem + ".json");
  std::vector<std::uint8_t> data = readFile(stem + ".bin");
  JsonDocument document;
  if (!document.read(std::string_view(reinterpret_cast<const char*>(text.data()), text.size())).isOk()) {
    return "its .json cannot be read";
  }
  const JsonValue facts = document.root();
  const auto size = static_cast<std::size_t>(facts.member("pad_to").integer().value_or(0));
  if (size > data.size()) {
    data.resize(size, static_cast<std::uint8_t>(facts.member("pad_byte").integer().value_or(0)));
  }
  if (textOf(facts.member("kind")) == "frame") {
    return frameDifference(viewOf(data), facts);
  }
  return textOf(facts.member("direction")) == "client_to_server" ? messageDifference<ClientMessage>(viewOf(data), facts)
                                                                 : messageDifference<ServerMessage>(viewOf(data), facts);
}

}  // namespace

int runWireCorpus(const std::string& folder) {
  Tally tally;
  for (const char* kind : {"/good/", "/bad/"}) {
    for (const std::string& name : filesOf(folder + kind, ".json")) {
      const std::string stem = name.substr(0, name.size() - 5);
      tally.add(kind + stem, whyNot(folder + kind + stem));
    }
  }
  return tally.finish();
}

}  // namespace terraport::tools
