#include "Core/Messages.h"

#include <limits>
#include <utility>

#include "Core/Value.h"

namespace terraport {
namespace {

constexpr std::size_t kMaxFrameBytes = 128 * 1024;
constexpr std::size_t kFrameHeaderBytes = 24;
constexpr std::size_t kMaxFrameHeaderBytes = 1024;
constexpr std::uint32_t kMaxSegmentBytes = 64U << 20;
constexpr std::size_t kRowBytes = 28;
constexpr std::size_t kMaxPlanSegments = 16384;
constexpr std::size_t kMaxMembers = 1024;
constexpr double kMaxDouble = std::numeric_limits<double>::max();
constexpr std::int64_t kMaxInteger = (std::int64_t{1} << 53) - 1;

// ---- writing

/// Writes a map whose number of members is known when it ends.
class MessageWriter {
 public:
  explicit MessageWriter(const char* type) : writer_(body_) { text("type", type); }

  void text(const char* name, std::string_view value) {
    key(name);
    writer_.text(value);
  }
  void textIf(const char* name, std::string_view value) {
    if (!value.empty()) text(name, value);
  }
  void integer(const char* name, std::uint64_t value) {
    key(name);
    writer_.integer(value);
  }
  template <typename T>
  void integerIf(const char* name, const std::optional<T>& value) {
    if (value) integer(name, *value);
  }
  void number(const char* name, double value) {
    key(name);
    writer_.number(value);
  }
  void numberIf(const char* name, const std::optional<double>& value) {
    if (value) number(name, *value);
  }
  void point(const char* name, const Vec3& value) {
    key(name);
    writer_.list(3);
    for (const double number : {value.x, value.y, value.z}) writer_.number(number);
  }
  void keys(const char* name, const Keys& value) {
    Bytes bytes;
    bytes.reserve(8 * value.size());
    for (const Key each : value) {
      for (int byte = 0; byte < 8; ++byte) bytes.push_back(static_cast<std::uint8_t>(each >> (8 * byte)));
    }
    key(name);
    writer_.binary(bytes);
  }
  /// Members that are written between `open` and `close` are those of a map.
  void open(const char* name) {
    key(name);
    outer_ = std::exchange(body_, {});
    outerCount_ = std::exchange(count_, 0);
  }
  void close() {
    Bytes inner = finish();
    body_ = std::move(outer_);
    body_.insert(body_.end(), inner.begin(), inner.end());
    count_ = outerCount_;
  }

  Bytes finish() {
    Bytes out;
    MsgpackWriter(out).map(count_);
    out.insert(out.end(), body_.begin(), body_.end());
    return out;
  }

 private:
  void key(const char* name) {
    writer_.text(name);
    ++count_;
  }

  Bytes body_, outer_;
  MsgpackWriter writer_;
  std::size_t count_ = 0, outerCount_ = 0;
};

// ---- reading

/// Reads the fields of a map, and remembers the first one that is missing or wrong.
class Fields {
 public:
  Fields(const Value& map, std::string name) : map_(map), name_(std::move(name)) {
    if (!map.isMap()) fail("", "a map");
  }

  const Value& value(const char* name) const { return map_[name]; }
  bool has(const char* name) const { return !map_[name].isAbsent(); }
  const Status& status() const { return status_; }

  void fail(const char* name, const char* expected) {
    if (status_.isOk()) status_ = Status::damaged("got a wrong " + name_ + "." + name + ", expected " + expected);
  }
  void include(const Status& status) {
    if (status_.isOk()) status_ = status;
  }

  template <typename T>
  void integer(const char* name, T& out, std::int64_t low = 0, std::int64_t high = kMaxU32) {
    const auto value = map_[name].integerIn(low, high);
    value ? void(out = static_cast<T>(*value)) : fail(name, "an integer in range");
  }
  template <typename T>
  void integerIf(const char* name, std::optional<T>& out, std::int64_t low = 0, std::int64_t high = kMaxU32) {
    if (has(name)) integer(name, out.emplace(), low, high);
  }
  void number(const char* name, double& out, double low, double high) {
    const auto value = map_[name].numberIn(low, high);
    value ? void(out = *value) : fail(name, "a number in range");
  }
  void numberIf(const char* name, std::optional<double>& out, double low, double high) {
    if (has(name)) number(name, out.emplace(), low, high);
  }
  void text(const char* name, std::string& out, std::size_t most, std::size_t least = 0) {
    auto value = map_[name].textUpTo(most);
    value && value->size() >= least ? void(out = std::move(*value)) : fail(name, "text of a length in range");
  }
  void textIf(const char* name, std::string& out, std::size_t most, std::size_t least = 0) {
    if (has(name)) text(name, out, most, least);
  }
  void flag(const char* name, bool& out) {
    const auto value = map_[name].flag();
    value ? void(out = *value) : fail(name, "true or false");
  }
  void point(const char* name, Vec3& out, double most = kMaxCoordinateM) {
    const auto value = map_[name].point(most);
    value ? void(out = *value) : fail(name, "three numbers in range");
  }
  void pointIf(const char* name, std::optional<Vec3>& out) {
    if (has(name)) point(name, out.emplace());
  }
  void role(bool& isGuide) {
    std::string text;
    choice("role", text, {"guide", "member"});
    isGuide = text == "guide";
  }
  void choice(const char* name, std::string& out, std::initializer_list<std::string_view> choices) {
    text(name, out, 64);
    for (const std::string_view each : choices) {
      if (out == each) return;
    }
    fail(name, "one of its words");
  }
  /// A lower-case word with digits and underscores.
  void code(const char* name, std::string& out) {
    text(name, out, 64, 1);
    const bool isWord = out.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789_") == std::string::npos;
    if (!isWord || out.empty() || out[0] < 'a') fail(name, "a word of lower-case letters");
  }
  void binary(const char* name, Bytes& out) {
    const ByteSpan bytes = map_[name].bytes();
    map_[name].isBinary() ? out.assign(bytes.data, bytes.data + bytes.size) : fail(name, "binary");
  }
  /// Rows of so many bytes, each given to `take`.
  template <typename Take>
  void rows(const char* name, std::size_t rowBytes, std::size_t most, Take take) {
    const ByteSpan bytes = map_[name].bytes();
    if (!map_[name].isBinary() || bytes.size % rowBytes != 0 || bytes.size / rowBytes > most) return fail(name, "binary rows");
    for (std::size_t at = 0; at < bytes.size; at += rowBytes) take(bytes.data + at);
  }
  void group(std::string& out) {
    text("group", out, 64, 1);
    for (const char letter : out) {
      const bool isLetter = (letter >= 'a' && letter <= 'z') || (letter >= 'A' && letter <= 'Z');
      if (!isLetter && std::string_view("0123456789_.~-").find(letter) == std::string_view::npos) fail("group", "a name");
    }
  }

 private:
  const Value& map_;
  std::string name_;
  Status status_;
};

void read(Fields& fields, Welcome& out) {
  fields.text("server", out.server, 128);
  fields.text("session", out.session, 64);
  Fields scene(fields.value("scene"), "scene");
  scene.text("id", out.scene.id, 128, 1);
  scene.text("name", out.scene.name, 256);
  scene.text("version", out.scene.version, 64, 1);
  scene.integer("segment_count", out.scene.segmentCount);
  scene.integer("base_faces", out.scene.baseFaces);
  scene.integer("levels", out.scene.levels, 1, 2);
  fields.include(scene.status());
  Fields limits(fields.value("limits"), "limits");
  limits.number("max_radius_m", out.limits.maxRadiusM, 0.0, kMaxRadiusM);
  limits.integer("max_message_bytes", out.limits.maxMessageBytes, 1, kMaxInteger);
  limits.number("max_messages_per_s", out.limits.maxMessagesPerS, 0.0, 1e9);
  limits.integer("max_credit_bytes", out.limits.maxCreditBytes, 1, kMaxInteger);
  limits.number("idle_timeout_s", out.limits.idleTimeoutS, 0.0, 1e9);
  limits.choice("groups", out.limits.groups, {"none", "here", "query"});
  fields.include(limits.status());
}

void read(Fields& fields, Plan& out) {
  fields.integer("generation", out.generation);
  fields.rows("show", kRowBytes, kMaxPlanSegments, [&out](const std::uint8_t* row) {
    const std::uint32_t flags = readU32(row + 24);
    out.show.push_back({readU64(row), readU32(row + 8), readU32(row + 12), readU32(row + 16), readU32(row + 20),
        (flags & 1) != 0, (flags & 2) != 0});
  });
  fields.binary("hidden", out.hidden);
  fields.integerIf("inner_count", out.innerCount, 0, static_cast<std::int64_t>(out.show.size()));
  if (fields.has("inner_hidden")) fields.binary("inner_hidden", out.innerHidden.emplace());
  if (out.innerCount.has_value() != out.innerHidden.has_value()) fields.fail("inner_hidden", "both of inner_*, or neither");
  fields.number("effective_radius_m", out.effectiveRadiusM, 0.0, kMaxRadiusM);
  fields.integer("omitted", out.omitted);
  if (fields.has("omitted_by")) {
    fields.choice("omitted_by", out.omittedBy, {"max_triangles", "max_bytes", "max_segments", "max_gpu_bytes"});
  }
}

void read(Fields& fields, Ready& out) {
  fields.integer("generation", out.generation);
  if (!fields.has("missing")) return;
  Keys& missing = out.missing.emplace();
  fields.rows("missing", 8, kMaxPlanSegments, [&missing](const std::uint8_t* row) { missing.push_back(readU64(row)); });
  if (fields.has("hidden")) fields.binary("hidden", out.hidden.emplace());
}

void read(Fields& fields, Picked& out) {
  fields.integer("request", out.request);
  if (!fields.has("hit")) return;
  Hit& hit = out.hit.emplace();
  Fields inner(fields.value("hit"), "hit");
  inner.point("position", hit.position);
  inner.point("normal", hit.normal, 1.5);
  inner.integer("segment", hit.segment);
  inner.integer("region", hit.region);
  inner.integerIf("stable_id", hit.stableId);
  inner.textIf("label", hit.label, 256);
  inner.number("height_m", hit.heightM, -1e9, 1e9);
  Fields attributes(inner.value("attributes"), "attributes");
  for (const auto& [name, value] : inner.value("attributes").members) {
    (void)value;
    attributes.number(name.c_str(), hit.attributes[name], -kMaxDouble, kMaxDouble);
  }
  inner.include(attributes.status());
  fields.include(inner.status());
}

void read(Fields& fields, Notice& out) {
  fields.code("kind", out.kind);
  fields.textIf("version", out.version, 64);
  if (fields.has("reconnect_after_ms")) fields.integer("reconnect_after_ms", out.reconnectAfterMs.emplace(), 0, kMaxInteger);
}

void read(Fields& fields, Error& out) {
  fields.code("code", out.code);
  fields.text("message", out.message, 1024);
  fields.flag("fatal", out.isFatal);
  fields.integerIf("generation", out.generation);
  fields.integerIf("request", out.request);
}

void read(Fields& fields, Joined& out) {
  fields.integer("request", out.request);
  fields.group(out.group);
  fields.integer("member", out.member, 1);
  fields.role(out.isGuide);
  fields.text("seat", out.seat, 64, 1);
}

void read(Fields& fields, Roster& out) {
  fields.group(out.group);
  const Value& members = fields.value("members");
  if (!members.isList() || members.items.size() > kMaxMembers) return fields.fail("members", "a list of members");
  for (const Value& each : members.items) {
    Member& member = out.members.emplace_back();
    Fields inner(each, "members");
    inner.integer("member", member.member, 1);
    inner.textIf("name", member.name, 64, 1);
    inner.role(member.isGuide);
    inner.flag("present", member.isPresent);
    inner.pointIf("position", member.position);
    fields.include(inner.status());
  }
}

void read(Fields& fields, Gathering& out) {
  constexpr double kAboveZero = 1e-300;
  fields.integer("gathering", out.gathering, 1);
  fields.integer("guide", out.guide, 1);
  fields.point("position", out.position);
  fields.number("radius_m", out.radiusM, kAboveZero, kMaxRadiusM);
  fields.numberIf("inner_radius_m", out.innerRadiusM, kAboveZero, kMaxRadiusM);
  fields.integerIf("left_ms", out.leftMs);
}

void read(Fields& fields, Gathered& out) {
  fields.integer("gathering", out.gathering, 1);
  const std::pair<const char*, std::vector<std::uint32_t>*> lists[] = {
      {"ready", &out.ready}, {"degraded", &out.degraded}, {"missing", &out.missing}};
  for (const auto& [name, list] : lists) {
    fields.rows(name, 4, kMaxMembers, [into = list](const std::uint8_t* row) { into->push_back(readU32(row)); });
  }
}

template <typename T>
Status readInto(const Value& map, const std::string& type, Message& out) {
  Fields fields(map, type);
  read(fields, out.emplace<T>());
  return fields.status();
}

}  // namespace

Bytes encode(const Hello& hello) {
  MessageWriter writer("hello");
  writer.text("client", hello.client);
  writer.textIf("token", hello.token);
  writer.open("budgets");
  writer.integerIf("max_triangles", hello.budgets.maxTriangles);
  writer.integerIf("max_bytes", hello.budgets.maxBytes);
  writer.integerIf("max_segments", hello.budgets.maxSegments);
  writer.integerIf("max_gpu_bytes", hello.budgets.maxGpuBytes);
  writer.integerIf("gpu_vertex_bytes", hello.budgets.gpuVertexBytes);
  writer.integerIf("gpu_face_bytes", hello.budgets.gpuFaceBytes);
  writer.close();
  writer.integer("credit_bytes", hello.creditBytes);
  return writer.finish();
}

Bytes encode(const Land& land) {
  MessageWriter writer(land.isPrefetch ? "prefetch" : "land");
  writer.integer("generation", land.generation);
  writer.point("position", land.place.position);
  writer.number("radius_m", land.place.radiusM);
  writer.numberIf("coarse_radius_m", land.place.coarseRadiusM);
  if (!land.isPrefetch) writer.numberIf("inner_radius_m", land.place.innerRadiusM);
  writer.keys("have", land.have);
  if (!land.without.empty()) writer.keys("without", land.without);
  writer.integer("taken_bytes", land.takenBytes);
  return writer.finish();
}

Bytes encode(const Pick& pick) {
  MessageWriter writer("pick");
  writer.integer("request", pick.request);
  writer.point("origin", pick.origin);
  if (pick.direction) writer.point("direction", *pick.direction);
  return writer.finish();
}

Bytes encode(const Join& join) {
  MessageWriter writer("join");
  writer.integer("request", join.request);
  writer.text("group", join.group);
  writer.text("role", join.isGuide ? "guide" : "member");
  writer.textIf("name", join.name);
  writer.textIf("seat", join.seat);
  return writer.finish();
}

Bytes encode(const Gather& gather) {
  MessageWriter writer("gather");
  writer.integer("request", gather.request);
  writer.point("position", gather.position);
  writer.number("radius_m", gather.radiusM);
  return writer.finish();
}

Bytes encode(const Arrived& arrived) {
  MessageWriter writer("arrived");
  writer.integer("gathering", arrived.gathering);
  constexpr const char* kStates[] = {"ready", "degraded", "declined"};
  writer.text("state", kStates[static_cast<int>(arrived.state)]);
  return writer.finish();
}

Bytes encodeCredit(std::uint64_t bytes) {
  MessageWriter writer("credit");
  writer.integer("bytes", bytes);
  return writer.finish();
}

Bytes encodeBare(const char* type) {
  return MessageWriter(type).finish();
}

Status decode(ByteSpan bytes, Message& out) {
  out = std::monostate();
  if (bytes.size > kMaxMessageBytes) return Status::damaged("got a message of more than 8 MiB, expected less");
  Value map;
  Status status = readMsgpack(bytes, map);
  if (!status.isOk()) return status;
  const auto type = map["type"].textUpTo(bytes.size);
  if (!map.isMap() || !type) return Status::damaged("got a message without a type, expected a map with one");
  if (*type == "welcome") return readInto<Welcome>(map, *type, out);
  if (*type == "plan") return readInto<Plan>(map, *type, out);
  if (*type == "ready") return readInto<Ready>(map, *type, out);
  if (*type == "picked") return readInto<Picked>(map, *type, out);
  if (*type == "notice") return readInto<Notice>(map, *type, out);
  if (*type == "error") return readInto<Error>(map, *type, out);
  if (*type == "joined") return readInto<Joined>(map, *type, out);
  if (*type == "roster") return readInto<Roster>(map, *type, out);
  if (*type == "gathering") return readInto<Gathering>(map, *type, out);
  if (*type == "gathered") return readInto<Gathered>(map, *type, out);
  return {};
}

Status decodeFrame(ByteSpan bytes, std::optional<Frame>& out) {
  out.reset();
  if (bytes.size == 0 || bytes.size > kMaxFrameBytes || bytes.data[0] == 0 || bytes.data[0] >= 0x80) {
    return Status::damaged("got " + std::to_string(bytes.size) + " bytes, expected a frame of at most 128 KiB");
  }
  if (bytes.data[0] != 1) return {};
  const std::size_t headerBytes = bytes.size < kFrameHeaderBytes ? 0 : readU16(bytes.data + 2);
  if (headerBytes < kFrameHeaderBytes || headerBytes > kMaxFrameHeaderBytes || headerBytes >= bytes.size) {
    return Status::damaged("got a frame of " + std::to_string(bytes.size) + " bytes, expected a header and payload");
  }
  Frame frame;
  frame.generation = readU32(bytes.data + 4);
  frame.key = readU64(bytes.data + 8);
  frame.offset = readU32(bytes.data + 16);
  frame.total = readU32(bytes.data + 20);
  frame.data = {bytes.data + headerBytes, bytes.size - headerBytes};
  if (frame.total > kMaxSegmentBytes || frame.offset > frame.total || frame.data.size > frame.total - frame.offset) {
    return Status::damaged("got a frame beyond its segment, expected a part of it");
  }
  out = frame;
  return {};
}

}  // namespace terraport
