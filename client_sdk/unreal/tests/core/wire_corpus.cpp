// The conformance corpus of the wire protocol (section 15): every message, good and bad, in both directions.
#include "Frames.h"
#include "Msgpack.h"
#include "Terraport/Json.h"
#include "Terraport/Transport.h"
#include "WireCodec.h"
#include "readable_form.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

using namespace terraport;

namespace {

std::string fileText(const std::filesystem::path& path) {
  std::FILE* const file = std::fopen(path.string().c_str(), "rb");
  REQUIRE(file != nullptr);
  std::string text;
  char buffer[65536];
  for (std::size_t count = 0; (count = std::fread(buffer, 1, sizeof buffer, file)) > 0;) text.append(buffer, count);
  std::fclose(file);
  return text;
}

ByteSpan bytesOf(const std::string& bytes) {
  return {reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()};
}

std::vector<std::filesystem::path> filesOf(const char* kind) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(std::string(TERRAPORT_CONFORMANCE "/wire/") + kind)) {
    if (entry.path().extension() == ".bin") files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

/// One pair of files.
struct Sample {
  std::string name;
  std::string bytes;
  std::string factsText;
  JsonDocument document;
  JsonValue facts;
  std::string kind;
  bool isFromClient = false;

  explicit Sample(const std::filesystem::path& path) : name(path.stem().string()), bytes(fileText(path)) {
    std::filesystem::path facts_path = path;
    factsText = fileText(facts_path.replace_extension(".json"));
    REQUIRE(document.read(factsText).isOk());
    facts = document.root();
    kind = std::string(facts.member("kind").text().value_or(""));
    isFromClient = facts.member("direction").text().value_or("") == "client_to_server";
    if (facts.member("pad_to").exists()) {
      bytes.resize(
          static_cast<std::size_t>(*facts.member("pad_to").integer()), static_cast<char>(*facts.member("pad_byte").integer()));
    }
  }
};

template <typename Message>
void expectGood(const Sample& sample) {
  MessageReader reader;
  Message message;
  DecodeError error;
  const bool isRead = reader.read(bytesOf(sample.bytes), message, error);
  CHECK_MESSAGE(isRead, error.message);
  if (!isRead) return;
  if (const std::optional<std::string_view> unknown = sample.facts.member("unknown").text()) {
    REQUIRE(std::holds_alternative<UnknownMessage>(message));
    CHECK(std::get<UnknownMessage>(message).type == *unknown);
    return;
  }
  EncodedMessage written;
  REQUIRE(encodeMessage(message, written).isOk());
  JsonDocument plain;
  REQUIRE(readMsgpack(written.view(), {}, plain).isOk());
  CHECK(tools::isAsStated(plain.root(), sample.facts.member("message")));
  if (sample.facts.member("canonical").boolean().value_or(false)) CHECK(written.bytes == sample.bytes);
}

void expectGoodFrame(const Sample& sample) {
  PayloadFrame frame;
  DecodeError error;
  const bool isRead = decodeFrame(bytesOf(sample.bytes), frame, error);
  CHECK_MESSAGE(isRead, error.message);
  if (!isRead) return;
  const JsonValue facts = sample.facts.member("frame");
  if (facts.member("unknown_kind").exists()) {
    REQUIRE(frame.unknownKind.has_value());
    CHECK(*frame.unknownKind == *facts.member("unknown_kind").integer());
    return;
  }
  CHECK(!frame.unknownKind.has_value());
  CHECK(frame.generation == *facts.member("generation").integer());
  CHECK(frame.segment == *facts.member("segment").integer());
  CHECK(frame.offset == *facts.member("offset").integer());
  CHECK(frame.total == *facts.member("total").integer());
  CHECK(frame.isLast == *facts.member("last").boolean());
  std::string hex;
  for (std::size_t at = 0; at < frame.chunk.size; ++at) {
    char digits[4];
    std::snprintf(digits, sizeof digits, "%02x", frame.chunk.data[at]);
    hex += digits;
  }
  CHECK(hex == *facts.member("chunk_hex").text());
  if (sample.facts.member("canonical").boolean().value_or(false)) {
    std::string again;
    REQUIRE(encodeFrame(frame, again).isOk());
    CHECK(again == sample.bytes);
  }
}

void expectError(const Sample& sample, const DecodeError& error) {
  const JsonValue expected = sample.facts.member("error");
  CHECK_MESSAGE(error.code == *expected.member("code").text(), error.message);
  CHECK(error.isFatal == *expected.member("fatal").boolean());
  if (expected.member("field").exists()) CHECK(error.field == *expected.member("field").text());
  CHECK(error.generation.has_value() == expected.member("generation").exists());
  if (error.generation) CHECK(*error.generation == *expected.member("generation").integer());
  CHECK(error.request.has_value() == expected.member("request").exists());
  if (error.request) CHECK(*error.request == *expected.member("request").integer());
  CHECK(!error.message.empty());
}

template <typename Message>
bool isRefused(const Sample& sample, DecodeError& error) {
  MessageReader reader;
  Message message;
  return !reader.read(bytesOf(sample.bytes), message, error);
}

}  // namespace

TEST_CASE("wire: every good message of the corpus is read, and written again") {
  const auto files = filesOf("good");
  // The corpus had 156 and 425 when this was written; an empty folder is no success.
  REQUIRE(files.size() >= 140);
  for (const auto& path : files) {
    const Sample sample(path);
    CAPTURE(sample.name);
    if (sample.kind == "frame") {
      expectGoodFrame(sample);
    } else if (sample.isFromClient) {
      expectGood<ClientMessage>(sample);
    } else {
      expectGood<ServerMessage>(sample);
    }
  }
}

TEST_CASE("wire: every bad message of the corpus is refused, with its code and field") {
  const auto files = filesOf("bad");
  REQUIRE(files.size() >= 400);
  for (const auto& path : files) {
    const Sample sample(path);
    CAPTURE(sample.name);
    DecodeError error;
    PayloadFrame frame;
    const bool refused = sample.kind == "frame" ? !decodeFrame(bytesOf(sample.bytes), frame, error)
        : sample.isFromClient                   ? isRefused<ClientMessage>(sample, error)
                                                : isRefused<ServerMessage>(sample, error);
    CHECK(refused);
    if (refused) expectError(sample, error);
  }
}

TEST_CASE("wire: a token becomes a subprotocol entry as the protocol says (2.3)") {
  CHECK(tokenSubprotocol("") == "terraport.token.");
  CHECK(tokenSubprotocol("a") == "terraport.token.YQ");
  CHECK(tokenSubprotocol("ab") == "terraport.token.YWI");
  CHECK(tokenSubprotocol("abc") == "terraport.token.YWJj");
  CHECK(tokenSubprotocol("\xFB\xEF\xBE\xFF") == "terraport.token.----_w");
}
