// Protocol 2 on the wire (spec/protocol.md, sections 3 and 10): the messages, and the frames that carry payload.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "Core/Basics.h"

namespace terraport {

constexpr char kSubprotocol[] = "terraport.v2.msgpack";
constexpr std::size_t kMaxMessageBytes = std::size_t{8} << 20;
constexpr std::size_t kMaxHave = 4096;
constexpr std::size_t kMaxWithout = 64;
constexpr double kMaxRadiusM = 1e6;
constexpr double kMaxCoordinateM = 1e7;

/// Name of a payload by its content.
using Key = std::uint64_t;
using Keys = std::vector<Key>;

// ---- from the client

struct Budgets {
  std::optional<std::uint64_t> maxTriangles, maxBytes, maxSegments, maxGpuBytes;
  /// Bytes that this client's buffers take for a vertex and for a face.
  std::optional<std::uint32_t> gpuVertexBytes, gpuFaceBytes;
};

struct Hello {
  std::string client;
  std::string token;
  Budgets budgets;
  std::uint64_t creditBytes = 0;
};

/// `land`, or `prefetch`.
struct Place {
  Vec3 position;
  double radiusM = 0.0;
  std::optional<double> coarseRadiusM;
  std::optional<double> innerRadiusM;
};

struct Land {
  bool isPrefetch = false;
  std::uint32_t generation = 0;
  Place place;
  Keys have;
  Keys without;
  std::uint64_t takenBytes = 0;
};

struct Pick {
  std::uint32_t request = 0;
  Vec3 origin;
  std::optional<Vec3> direction;
};

struct Join {
  std::uint32_t request = 0;
  std::string group;
  bool isGuide = false;
  std::string name;
  std::string seat;
};

struct Gather {
  std::uint32_t request = 0;
  Vec3 position;
  double radiusM = 0.0;
};

enum class Arrival : std::uint8_t { Ready, Degraded, Declined };

struct Arrived {
  std::uint32_t gathering = 0;
  Arrival state = Arrival::Ready;
};

Bytes encode(const Hello& hello);
Bytes encode(const Land& land);
Bytes encode(const Pick& pick);
Bytes encode(const Join& join);
Bytes encode(const Gather& gather);
Bytes encode(const Arrived& arrived);
Bytes encodeCredit(std::uint64_t bytes);
/// A message without fields: `bye`, `leave`.
Bytes encodeBare(const char* type);

// ---- from the service

struct SceneFacts {
  std::string id, name, version;
  std::uint32_t segmentCount = 0;
  std::uint32_t baseFaces = 0;
  std::uint32_t levels = 1;
};

struct Limits {
  double maxRadiusM = 0.0;
  double maxMessagesPerS = 0.0;
  std::uint64_t maxMessageBytes = 0;
  std::uint64_t maxCreditBytes = 0;
  double idleTimeoutS = 0.0;
  /// "none", "here" or "query".
  std::string groups;
};

struct Welcome {
  std::string server, session;
  SceneFacts scene;
  Limits limits;
};

struct SegmentRow {
  Key key = 0;
  /// Number in this version.
  std::uint32_t id = 0;
  std::uint32_t bytes = 0;
  std::uint32_t faces = 0;
  std::uint32_t vertices = 0;
  bool follows = false;
  bool isCoarse = false;
};

struct Plan {
  std::uint32_t generation = 0;
  std::vector<SegmentRow> show;
  /// Gzip streams of one bit a base face.
  Bytes hidden;
  std::optional<std::uint32_t> innerCount;
  std::optional<Bytes> innerHidden;
  double effectiveRadiusM = 0.0;
  std::uint32_t omitted = 0;
  std::string omittedBy;
};

struct Ready {
  std::uint32_t generation = 0;
  std::optional<Keys> missing;
  std::optional<Bytes> hidden;
};

struct Hit {
  Vec3 position, normal;
  std::uint32_t segment = 0;
  std::uint32_t region = 0;
  std::optional<std::uint32_t> stableId;
  std::string label;
  double heightM = 0.0;
  std::map<std::string, double> attributes;
};

struct Picked {
  std::uint32_t request = 0;
  std::optional<Hit> hit;
};

struct Notice {
  std::string kind, version;
  std::optional<double> reconnectAfterMs;
};

struct Error {
  std::string code, message;
  bool isFatal = false;
  std::optional<std::uint32_t> generation, request;
};

struct Joined {
  std::uint32_t request = 0;
  std::string group;
  std::uint32_t member = 0;
  bool isGuide = false;
  std::string seat;
};

struct Member {
  std::uint32_t member = 0;
  std::string name;
  bool isGuide = false;
  bool isPresent = false;
  std::optional<Vec3> position;
};

struct Roster {
  std::string group;
  std::vector<Member> members;
};

struct Gathering {
  std::uint32_t gathering = 0;
  std::uint32_t guide = 0;
  Vec3 position;
  double radiusM = 0.0;
  std::optional<double> innerRadiusM;
  /// Absent where nobody waits any more.
  std::optional<std::uint32_t> leftMs;
};

struct Gathered {
  std::uint32_t gathering = 0;
  std::vector<std::uint32_t> ready, degraded, missing;
};

/// `monostate`: a type that this version does not know, which is skipped.
using Message = std::variant<std::monostate, Welcome, Plan, Ready, Picked, Notice, Error, Joined, Roster, Gathering, Gathered>;

/// Read one message of the service. Fails where it has no structure, or a known message lacks a field or has a wrong one.
Status decode(ByteSpan bytes, Message& out);

// ---- frames

struct Frame {
  std::uint32_t generation = 0;
  Key key = 0;
  std::uint32_t offset = 0;
  /// Bytes of the whole payload.
  std::uint32_t total = 0;
  /// A view of the received bytes.
  ByteSpan data;
};

/// Whether a WebSocket message is a frame, and not a message.
inline bool isFrame(ByteSpan bytes) {
  return bytes.size > 0 && bytes.data[0] < 0x80;
}

/// Read a frame; no value for a kind that is skipped.
Status decodeFrame(ByteSpan bytes, std::optional<Frame>& out);

}  // namespace terraport
