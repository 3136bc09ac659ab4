// The engine-free core, for tests in Python: a command a line on standard input, a line of JSON for each.
//
//   server HEX                           read a message or frame of the service
//   client HEX                           read the fields of a client's message, and write them
//   segment|base FILE ATTRIBUTES         decode a payload: its arrays, and as the engine gets them
//   speed FILE ATTRIBUTES SECONDS        decode a file of segments again and again: speed, allocations after two rounds
//   begin CREDIT MAX_SEGMENTS            a new session; then the steps of tests/conformance/landings, numbers for null: -1
//   connected, lost, receive HEX, land X Y Z RADIUS INNER COARSE, hurry N, aim X Y Z RADIUS, pick X Y Z, send
#include <zlib.h>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <iterator>
#include <memory>
#include <new>
#include <sstream>

#include "Core/Segment.h"
#include "Core/Session.h"
#include "Core/Value.h"
#include "TerraportAxes.h"

namespace {

using namespace terraport;

std::atomic<long long> allocations{0};

std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char letter : text) {
    char code[8];
    std::snprintf(code, sizeof code, "\\u%04x", static_cast<unsigned char>(letter));
    const bool isPlain = letter != '"' && letter != '\\' && static_cast<unsigned char>(letter) >= 0x20;
    out += isPlain ? std::string(1, letter) : std::string(code);
  }
  return out + "\"";
}

std::string hex(ByteSpan bytes) {
  std::string out;
  for (std::size_t at = 0; at < bytes.size; ++at) {
    out += {"0123456789abcdef"[bytes.data[at] >> 4], "0123456789abcdef"[bytes.data[at] & 15]};
  }
  return out;
}

Bytes ofHex(const std::string& text) {
  Bytes out;
  for (std::size_t at = 0; at + 1 < text.size(); at += 2) {
    out.push_back(static_cast<std::uint8_t>(std::stoul(text.substr(at, 2), nullptr, 16)));
  }
  return out;
}

/// A JSON object under construction. Text that is absent when empty, and absent numbers, are left out.
class Object {
 public:
  Object& raw(const char* name, const std::string& json) {
    text_ += (text_.empty() ? "" : ",") + quoted(name) + ":" + json;
    return *this;
  }
  Object& text(const char* name, const std::string& value) { return raw(name, quoted(value)); }
  Object& textIf(const char* name, const std::string& value) { return value.empty() ? *this : text(name, value); }
  Object& flag(const char* name, bool value) { return raw(name, value ? "true" : "false"); }
  Object& number(const char* name, double value) { return raw(name, numberText(value)); }
  template <typename T>
  Object& numberIf(const char* name, const std::optional<T>& value) {
    return value ? number(name, static_cast<double>(*value)) : *this;
  }
  Object& bytes(const char* name, ByteSpan value) { return text(name, hex(value)); }
  Object& point(const char* name, const Vec3& value) { return list(name, std::vector<double>{value.x, value.y, value.z}); }
  template <typename T>
  Object& list(const char* name, const std::vector<T>& values) {
    std::string json;
    for (const T value : values) json += (json.empty() ? "" : ",") + numberText(static_cast<double>(value));
    return raw(name, "[" + json + "]");
  }
  std::string json() const { return "{" + text_ + "}"; }

  static std::string numberText(double value) {
    char digits[40];
    std::snprintf(digits, sizeof digits, "%.17g", value);
    return digits;
  }

 private:
  std::string text_;
};

// ---- messages: what was read, as the corpus states it, binaries in hexadecimal digits

Object described(const Welcome& m) {
  Object scene, limits;
  scene.text("id", m.scene.id).text("name", m.scene.name).text("version", m.scene.version);
  scene.number("segment_count", m.scene.segmentCount).number("base_faces", m.scene.baseFaces).number("levels", m.scene.levels);
  limits.number("max_radius_m", m.limits.maxRadiusM).number("max_messages_per_s", m.limits.maxMessagesPerS);
  limits.number("max_message_bytes", static_cast<double>(m.limits.maxMessageBytes));
  limits.number("max_credit_bytes", static_cast<double>(m.limits.maxCreditBytes));
  limits.number("idle_timeout_s", m.limits.idleTimeoutS).text("groups", m.limits.groups);
  return Object().text("server", m.server).text("session", m.session).raw("scene", scene.json()).raw("limits", limits.json());
}

Object described(const Plan& m) {
  Bytes rows;
  const auto add = [&rows](std::uint64_t number, int bytes) {
    for (int byte = 0; byte < bytes; ++byte) rows.push_back(static_cast<std::uint8_t>(number >> (8 * byte)));
  };
  for (const SegmentRow& row : m.show) {
    add(row.key, 8);
    for (const std::uint32_t number : {row.id, row.bytes, row.faces, row.vertices}) add(number, 4);
    add((row.follows ? 1U : 0U) | (row.isCoarse ? 2U : 0U), 4);
  }
  Object out;
  out.number("generation", m.generation).bytes("show", rows).bytes("hidden", m.hidden).numberIf("inner_count", m.innerCount);
  if (m.innerHidden) out.bytes("inner_hidden", *m.innerHidden);
  out.number("effective_radius_m", m.effectiveRadiusM).number("omitted", m.omitted).textIf("omitted_by", m.omittedBy);
  return out;
}

Object described(const Ready& m) {
  Object out;
  out.number("generation", m.generation);
  if (!m.missing) return out;
  Bytes keys;
  for (const Key key : *m.missing) {
    for (int byte = 0; byte < 8; ++byte) keys.push_back(static_cast<std::uint8_t>(key >> (8 * byte)));
  }
  out.bytes("missing", keys);
  return m.hidden ? out.bytes("hidden", *m.hidden) : out;
}

Object described(const Picked& m) {
  Object out;
  out.number("request", m.request);
  if (!m.hit) return out;
  Object hit, attributes;
  for (const auto& [name, value] : m.hit->attributes) attributes.number(name.c_str(), value);
  hit.point("position", m.hit->position).point("normal", m.hit->normal).number("segment", m.hit->segment);
  hit.number("region", m.hit->region).numberIf("stable_id", m.hit->stableId).textIf("label", m.hit->label);
  hit.number("height_m", m.hit->heightM).raw("attributes", attributes.json());
  return out.raw("hit", hit.json());
}

Object described(const Notice& m) {
  return Object().text("kind", m.kind).textIf("version", m.version).numberIf("reconnect_after_ms", m.reconnectAfterMs);
}

Object described(const Error& m) {
  Object out;
  out.text("code", m.code).text("message", m.message).flag("fatal", m.isFatal);
  return out.numberIf("generation", m.generation).numberIf("request", m.request);
}

Object described(const Joined& m) {
  Object out;
  out.number("request", m.request).text("group", m.group).number("member", m.member);
  return out.text("role", m.isGuide ? "guide" : "member").text("seat", m.seat);
}

Object described(const Roster& m) {
  std::string members;
  for (const Member& each : m.members) {
    Object member;
    member.number("member", each.member).textIf("name", each.name).text("role", each.isGuide ? "guide" : "member");
    member.flag("present", each.isPresent);
    if (each.position) member.point("position", *each.position);
    members += (members.empty() ? "" : ",") + member.json();
  }
  return Object().text("group", m.group).raw("members", "[" + members + "]");
}

Object described(const Gathering& m) {
  Object out;
  out.number("gathering", m.gathering).number("guide", m.guide).point("position", m.position).number("radius_m", m.radiusM);
  return out.numberIf("inner_radius_m", m.innerRadiusM).numberIf("left_ms", m.leftMs);
}

Object described(const Gathered& m) {
  return Object()
      .number("gathering", m.gathering)
      .list("ready", m.ready)
      .list("degraded", m.degraded)
      .list("missing", m.missing);
}

Object described(const std::monostate&) {
  return Object().flag("skip", true);
}

std::string readServer(ByteSpan bytes) {
  Status status;
  std::string json;
  if (isFrame(bytes)) {
    std::optional<Frame> frame;
    status = decodeFrame(bytes, frame);
    Object out;
    if (!frame) return status.isOk() ? "{\"skip\":true}" : Object().text("refused", status.message()).json();
    out.number("generation", frame->generation).text("key", hexOf(frame->key)).number("offset", frame->offset);
    return Object().raw("frame", out.number("total", frame->total).bytes("data", frame->data).json()).json();
  }
  Message message;
  status = decode(bytes, message);
  if (!status.isOk()) return Object().text("refused", status.message()).json();
  const std::string fields = std::visit([](const auto& each) { return described(each).json(); }, message);
  return std::holds_alternative<std::monostate>(message) ? fields : Object().raw("message", fields).json();
}

Keys keysOf(const Value& binary) {
  Keys keys;
  for (std::size_t at = 0; at + 8 <= binary.text.size(); at += 8) keys.push_back(readU64(binary.bytes().data + at));
  return keys;
}

template <typename T>
std::optional<T> wholeOf(const Value& value) {
  return value.isAbsent() ? std::nullopt : std::optional<T>(static_cast<T>(value.integer));
}

/// Write a client's message from its fields; empty for one that this client never sends.
Bytes writeClient(const Value& m) {
  const std::string& type = m["type"].text;
  const auto request = static_cast<std::uint32_t>(m["request"].integer);
  const Vec3 position = m["position"].point().value_or(Vec3());
  const double radiusM = m["radius_m"].numberIn(0, 1e9).value_or(0);
  if (type == "hello") {
    const Value& b = m["budgets"];
    const Budgets budgets{wholeOf<std::uint64_t>(b["max_triangles"]), wholeOf<std::uint64_t>(b["max_bytes"]),
        wholeOf<std::uint64_t>(b["max_segments"]), wholeOf<std::uint64_t>(b["max_gpu_bytes"]),
        wholeOf<std::uint32_t>(b["gpu_vertex_bytes"]), wholeOf<std::uint32_t>(b["gpu_face_bytes"])};
    return encode(Hello{m["client"].text, m["token"].text, budgets, static_cast<std::uint64_t>(m["credit_bytes"].integer)});
  }
  if (type == "land" || type == "prefetch") {
    const Place place{position, radiusM, m["coarse_radius_m"].numberIn(0, 1e9), m["inner_radius_m"].numberIn(0, 1e9)};
    return encode(Land{type == "prefetch", static_cast<std::uint32_t>(m["generation"].integer), place, keysOf(m["have"]),
        keysOf(m["without"]), static_cast<std::uint64_t>(m["taken_bytes"].integer)});
  }
  if (type == "pick") return encode(Pick{request, m["origin"].point().value_or(Vec3()), m["direction"].point()});
  if (type == "credit") return encodeCredit(static_cast<std::uint64_t>(m["bytes"].integer));
  if (type == "join") {
    return encode(Join{request, m["group"].text, m["role"].text == "guide", m["name"].text, m["seat"].text});
  }
  if (type == "gather" && m["deadline_ms"].isAbsent() && m["inner_radius_m"].isAbsent()) {
    return encode(Gather{request, position, radiusM});
  }
  if (type == "arrived") {
    const Arrival state = m["state"].text == "ready" ? Arrival::Ready
        : m["state"].text == "degraded"              ? Arrival::Degraded
                                                     : Arrival::Declined;
    return encode(Arrived{static_cast<std::uint32_t>(m["gathering"].integer), state});
  }
  return type == "bye" || type == "leave" ? encodeBare(type.c_str()) : Bytes();
}

// ---- segments

Bytes fileOf(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return Bytes(std::istreambuf_iterator<char>(file), {});
}

std::string arraysOf(const Bytes& payload, std::size_t attributes, SegmentDecoder::Kind kind) {
  static SegmentDecoder decoder;
  static SegmentMesh mesh;  // One for all: what an earlier payload left must not show through.
  const Status status = decoder.decode(payload, attributes, kind, mesh);
  if (!status.isOk()) return Object().text("refused", status.message()).json();
  Object out;
  out.list("positions", mesh.positions).list("faces", mesh.indices).list("normals", mesh.normals);
  out.list("colours", mesh.colours).list("region_ids", mesh.regions).list("uvs", mesh.uvs);
  std::vector<float> unrealPositions(mesh.positions.size()), unrealNormals(mesh.positions.size());
  for (std::size_t at = 0; at < mesh.positions.size(); at += 3) {
    TerraportAxes::PointToUnreal(&mesh.positions[at], &unrealPositions[at]);
    TerraportAxes::NormalToUnreal(&mesh.normals[at], &unrealNormals[at]);
  }
  out.list("unreal_positions", unrealPositions).list("unreal_normals", unrealNormals);
  std::string codes;
  for (const auto& column : mesh.attributes) codes += (codes.empty() ? "" : ",") + Object().list("codes", column).json();
  out.raw("attributes", "[" + codes + "]").list("low", std::vector<float>(mesh.bounds.low, mesh.bounds.low + 3));
  out.list("high", std::vector<float>(mesh.bounds.high, mesh.bounds.high + 3)).text("media_type", mediaTypeOf(mesh.image.kind));
  out.number("width", mesh.image.width).number("height", mesh.image.height);
  out.number("image_offset", static_cast<double>(mesh.image.offset));
  out.number("gpu_bytes", static_cast<double>(mesh.image.gpuBytes()));
  out.number("image_crc", static_cast<double>(crc32(0, mesh.image.fileOf(payload).data, static_cast<uInt>(mesh.image.bytes))));
  return out.json();
}

std::string speedOf(const Bytes& file, std::size_t attributes, double seconds) {
  std::vector<ByteSpan> payloads;
  for (std::size_t at = 0; at + 12 <= file.size(); at += payloads.back().size) {
    payloads.emplace_back(file.data() + at, 12 + std::size_t{readU32(&file[at + 4])} + readU32(&file[at + 8]));
  }
  SegmentDecoder decoder;
  SegmentMesh mesh;
  double faces = 0.0, elapsed = 0.0;
  long long rounds = 0, before = 0;
  const auto start = std::chrono::steady_clock::now();
  for (; elapsed < seconds || rounds < 3; ++rounds) {
    if (rounds == 2) before = allocations;  // Buffers have grown.
    for (const ByteSpan payload : payloads) {
      if (!decoder.decode(payload, attributes, SegmentDecoder::Kind::Segment, mesh).isOk()) return "{}";
      faces += mesh.faceCount;
    }
    elapsed = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  }
  const auto allocated = static_cast<double>(allocations - before);
  const auto count = static_cast<double>(rounds) * static_cast<double>(payloads.size());
  Object out;
  out.number("mtriangles_per_s", faces / 1e6 / elapsed).number("segments_per_s", count / elapsed);
  out.number("payload_mb_per_s", static_cast<double>(rounds) * static_cast<double>(file.size()) / 1e6 / elapsed);
  return out.number("allocations", allocated).json();
}

// ---- histories

class Player {
 public:
  Player(std::uint64_t credit, std::int64_t maxSegments) : session_(optionsOf(credit, maxSegments), {}) {}

  std::string play(const std::string& step, std::istream& given) {
    Object told;
    std::vector<double> numbers;
    if (step == "receive") {
      std::string text;
      given >> text;
      const Status status = session_.receive(ofHex(text));
      if (!status.isOk()) return Object().text("refused", status.message()).json();
    } else {
      for (double number = 0.0; given >> number;) numbers.push_back(number);
    }
    numbers.resize(8, -1.0);
    const Vec3 point{numbers[0], numbers[1], numbers[2]};
    const auto orNone = [&numbers](std::size_t at) { return numbers[at] < 0 ? std::nullopt : std::optional(numbers[at]); };
    if (step == "connected") session_.connected();
    if (step == "lost") session_.connectionLost();
    if (step == "land") session_.land({point, numbers[3], orNone(5), orNone(4)});
    if (step == "hurry") session_.hurry(static_cast<std::int64_t>(numbers[0]));
    if (step == "pick") session_.pick(point, std::nullopt);
    if (step == "aim") {
      session_.aim({point, numbers[3], std::nullopt, std::nullopt});
      session_.flushAim();
    }
    if (step == "send") {
      std::string sent;
      for (const Bytes& message : session_.takeMessages()) sent += (sent.empty() ? "" : ",") + quoted(hex(message));
      told.raw("sent", "[" + sent + "]");
    }
    takeEvents(told);
    std::string keys;
    for (const SegmentRow& row : session_.shownRows()) keys += (keys.empty() ? "" : ",") + quoted(hexOf(row.key));
    return told.raw("shown", "[" + keys + "]").number("hidden", crcOf(session_.shownHidden())).json();
  }

 private:
  static SessionOptions optionsOf(std::uint64_t credit, std::int64_t maxSegments) {
    SessionOptions options;
    options.client = "corpus";
    options.creditBytes = credit;
    if (maxSegments >= 0) options.budgets.maxSegments = static_cast<std::uint64_t>(maxSegments);
    return options;
  }

  static double crcOf(const Bytes& bytes) {
    return static_cast<double>(crc32(0, bytes.data(), static_cast<uInt>(bytes.size())));
  }

  void takeEvents(Object& told) {
    for (std::vector<Event> events = session_.takeEvents(); !events.empty(); events = session_.takeEvents()) {
      for (const Event& event : events) {
        if (const auto* came = std::get_if<SegmentCame>(&event)) {
          SegmentMesh mesh;
          const bool isGood = SegmentDecoder().decode(*came->payload, 0, SegmentDecoder::Kind::Segment, mesh).isOk();
          isGood ? session_.decoded(came->key, mesh.bounds, came->payload) : session_.damaged(came->key);
        } else if (const auto* inner = std::get_if<InnerComplete>(&event)) {
          told.list("inner", std::vector<double>{static_cast<double>(inner->rows.size()), crcOf(inner->hidden)});
        } else if (const auto* refused = std::get_if<Refused>(&event); refused != nullptr && refused->code == "damaged") {
          told.text("given_up", refused->message);
        }
      }
    }
  }

  Session session_;
};

std::string answerTo(const std::string& verb, std::istream& given, std::unique_ptr<Player>& player) {
  std::string text;
  double first = 0.0, second = 0.0;
  if (verb == "server" || verb == "client") {
    given >> text;
    const Bytes bytes = ofHex(text);
    if (verb == "server") return readServer(bytes);
    Value map;
    const Status status = readMsgpack(bytes, map);
    return status.isOk() ? Object().bytes("written", writeClient(map)).json() : "{}";
  }
  if (verb == "segment" || verb == "base") {
    given >> text >> first;
    const auto kind = verb == "base" ? SegmentDecoder::Kind::Base : SegmentDecoder::Kind::Segment;
    return arraysOf(fileOf(text), static_cast<std::size_t>(first), kind);
  }
  if (verb == "speed") {
    given >> text >> first >> second;
    return speedOf(fileOf(text), static_cast<std::size_t>(first), second);
  }
  if (verb == "begin") {
    given >> first >> second;
    player = std::make_unique<Player>(static_cast<std::uint64_t>(first), static_cast<std::int64_t>(second));
    return "{}";
  }
  return player->play(verb, given);
}

}  // namespace

// Not inlined: the compiler would take them for a mismatched pair.
[[gnu::noinline]] void* operator new(std::size_t size) {
  ++allocations;
  if (void* memory = std::malloc(size)) return memory;
  std::abort();
}
[[gnu::noinline]] void operator delete(void* memory) noexcept {
  std::free(memory);
}
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept {
  std::free(memory);
}

int main() {
  std::unique_ptr<Player> player;
  for (std::string line; std::getline(std::cin, line);) {
    std::istringstream given(line);
    std::string verb;
    given >> verb;
    std::cout << answerTo(verb, given, player) << "\n" << std::flush;
  }
  return 0;
}
