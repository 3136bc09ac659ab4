// Pieces to messages, and addresses.
#include "Terraport/MessageAssembler.h"
#include "Terraport/SceneUrl.h"

#include <doctest/doctest.h>

#include <string>

using namespace terraport;

namespace {

ByteSpan spanOf(const std::string& text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

std::string textOf(const TransportMessage& message) {
  return std::string(message.bytes.begin(), message.bytes.end());
}

MessageAssembler::Limits limitsOf(std::size_t message, std::size_t waiting) {
  MessageAssembler::Limits limits;
  limits.maxMessageBytes = message;
  limits.maxWaitingBytes = waiting;
  return limits;
}

}  // namespace

TEST_CASE("transport: pieces become messages, in order") {
  MessageAssembler assembler;
  TransportMessage message;
  CHECK(!assembler.tryNext(message));
  REQUIRE(assembler.take(spanOf("ab"), true, false).isOk());
  CHECK(!assembler.tryNext(message));
  REQUIRE(assembler.takeRemaining(spanOf("c"), true, 1).isOk());
  REQUIRE(assembler.takeRemaining(spanOf("d"), true, 0).isOk());
  REQUIRE(assembler.take({}, false, true).isOk());
  REQUIRE(assembler.take(spanOf("xyz"), false, true).isOk());
  CHECK(assembler.waitingBytes() == 7);
  REQUIRE(assembler.tryNext(message));
  CHECK(message.isText);
  CHECK(textOf(message) == "abcd");
  REQUIRE(assembler.tryNext(message));
  CHECK(!message.isText);
  CHECK(message.bytes.empty());
  REQUIRE(assembler.tryNext(message));
  CHECK(textOf(message) == "xyz");
  CHECK(assembler.waitingBytes() == 0);
  for (int count = 0; count < 100; ++count) {
    REQUIRE(assembler.take(spanOf(std::to_string(count)), false, true).isOk());
    REQUIRE(assembler.tryNext(message));
    CHECK(textOf(message) == std::to_string(count));
  }
}

TEST_CASE("transport: messages beyond the bounds are refused") {
  MessageAssembler assembler(limitsOf(4, 6));
  REQUIRE(assembler.take(spanOf("abc"), false, false).isOk());
  CHECK(assembler.take(spanOf("de"), false, false).code() == "too_large");
  assembler.clear();
  REQUIRE(assembler.take(spanOf("abc"), false, false).isOk());
  CHECK(assembler.take(spanOf("d"), true, true).code() == "malformed");
  assembler.clear();
  REQUIRE(assembler.take(spanOf("abcd"), false, true).isOk());
  CHECK(assembler.hasRoom());
  CHECK(assembler.take(spanOf("abcd"), false, true).code() == "too_large");
  assembler.clear();
  CHECK(assembler.waitingBytes() == 0);
  // One message may wait, whatever its size.
  MessageAssembler narrow(limitsOf(100, 10));
  REQUIRE(narrow.take(spanOf(std::string(50, 'x')), false, true).isOk());
  CHECK(!narrow.hasRoom());
  CHECK(narrow.take(spanOf("y"), false, true).code() == "too_large");
}

TEST_CASE("urls: every form that a user may paste") {
  const std::vector<std::vector<std::string>> cases{{"http://h/scenes/a", "http://h", "a", "ws://h/scenes/a/stream"},
      {"https://h:8443/scenes/a/", "https://h:8443", "a", "wss://h:8443/scenes/a/stream"},
      {"ws://h/p/q/scenes/a/stream", "http://h/p/q", "a", "ws://h/p/q/scenes/a/stream"},
      {"WSS://H.Example/scenes/%C3%A9t%C3%A9", "https://h.example", "\xC3\xA9t\xC3\xA9",
          "wss://h.example/scenes/%C3%A9t%C3%A9/stream"},
      {"http://[::1]:8000/scenes/a b", "", "", ""},
      {"http://[::1]:8000/scenes/a%20b", "http://[::1]:8000", "a b", "ws://[::1]:8000/scenes/a%20b/stream"},
      {"http://h/scenes/stream", "http://h", "stream", "ws://h/scenes/stream/stream"}, {"http://h", "http://h", "", ""},
      {"http://h/prefix/", "http://h/prefix", "", ""}, {"http://h/scenes/", "http://h", "", ""}};
  for (const auto& row : cases) {
    CAPTURE(row[0]);
    const Result<SceneUrl> parsed = parseSceneUrl(row[0]);
    REQUIRE(parsed.isOk() == !row[1].empty());
    if (row[1].empty()) continue;
    CHECK(parsed.value().server == row[1]);
    CHECK(parsed.value().scene == row[2]);
    const Result<std::string> stream = streamUrl(row[0]);
    CHECK(stream.isOk() == !row[3].empty());
    if (stream.isOk()) CHECK(stream.value() == row[3]);
  }
  CHECK(sceneUrlOf("wss://h/p/scenes/old", "a b/c").value() == "https://h/p/scenes/a%20b%2Fc");
}

TEST_CASE("urls: what is none is refused") {
  for (const char* const url : {"", "h/scenes/a", "ftp://h/scenes/a", "http://", "http:///scenes/a",
           "http://user:pw@h/scenes/a", "http://h/scenes/a?token=secret", "ftp://user:secret@h/", "http://h/scenes/a#f",
           "http://h/scenes/a/b", "http://h/scenesX/a", "http://h:port/scenes/a", "http://h:/scenes/a",
           "http://h:99999/scenes/a", "http://h:000080/scenes/a", "http://h/scenes/a/segments/3.glb", "quarry",
           "http://h/scenes/%zz", "http://h/scenes/%", "http://h/scenes/%ff", "http://h /scenes/a", "http://h\\x/scenes/a",
           "http://[::1/scenes/a", "http://h/scenes/a\nb"}) {
    CAPTURE(url);
    const Status status = parseSceneUrl(url).status();
    CHECK(status.code() == "invalid_url");
    // A token or a password that was pasted with it does not go into logs.
    CHECK(status.message().find("pw") == std::string::npos);
    CHECK(status.message().find("secret") == std::string::npos);
  }
}
