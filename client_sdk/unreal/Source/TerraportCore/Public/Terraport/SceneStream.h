#pragma once

#include "Terraport/Api.h"
#include "Terraport/LandingStream.h"
#include "Terraport/Status.h"
#include "Terraport/StreamOptions.h"
#include "Terraport/Transport.h"
#include "Terraport/Types.h"

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

namespace terraport {

/// A session over all its connections, as an application sees it: `SceneStream` pumped by its owner, or `StreamThread` with
/// a thread of its own. Nothing here blocks on the network. All calls come from one thread.
class TERRAPORTCORE_API ISceneStream : public LandingStream {
 public:
  // land, aim, payload: see LandingStream. A number that the protocol does not allow (a NaN, a radius of 0, a
  // deadline without an inner radius) is told as a `Refused` event with the code `invalid_field`; `land` then returns
  // kNoLanding, and nothing has changed.

  /// Ask what full detail has along a ray from `origin`, or along the vertical line through it where there is no
  /// `direction`. Returns the number of the request in `Picked` or `PickRefused`.
  /// Errors: `invalid_field`; `too_many` while 64 picks wait.
  virtual Result<std::uint64_t> pick(const Vec3& origin, const std::optional<Vec3>& direction) = 0;

  /// Take a seat in a group of this scene (1 to 64 of `A-Z a-z 0-9 _ . ~ -`); a seat held before is left. The connection is
  /// made anew, to where the group is; nothing that is held comes again. A lost connection takes the seat again by itself.
  /// `ownName` is what the others see; empty for none. Returns the number of the request in `GroupRefused`; else `GroupJoined`
  /// follows. Error: `invalid_field`.
  virtual Result<std::uint64_t> joinGroup(const std::string& group, GroupRole role, const std::string& ownName) = 0;

  /// Give the seat in the group up; nothing where there is none.
  virtual void leaveGroup() = 0;

  /// Land the group, as its guide, who is told of it like everybody: `GroupCalled`. Each member's own bounds cut what it loads.
  /// `deadlineMs`: when nobody waits any longer; absent takes the server's, which also bounds it. Returns the number of the
  /// request in `GroupRefused`. Error: `invalid_field`.
  virtual Result<std::uint64_t> gather(const Vec3& position, double radiusM, const std::optional<double>& innerRadiusM,
      const std::optional<std::uint32_t>& deadlineMs) = 0;

  /// Say how the own part of a group landing ended; `GroupFollower` does it by itself. Nothing where a newer one has come.
  virtual void arrive(std::uint32_t gathering, GroupArrival how) = 0;

  /// The oldest event that was not taken, swapped into `event`; false where there is none. Events must be taken: while more
  /// than a bounded number waits, the stream takes nothing from the network.
  virtual bool tryNextEvent(StreamEvent& event) = 0;

  virtual StreamStats stats() const = 0;

  /// Connect now, unless connected already; a token that is not empty replaces the present one and makes a new connection
  /// in any case, and stands for a `tokenProvider` from now on. After `Closed`, or to cut a wait short.
  virtual void reconnect(const std::string& token) = 0;

  /// Say goodbye and free the connection; nothing is sent any more. What is held can still be asked for.
  virtual void close() = 0;
};

/// The stream, without threads: everything happens in `pump`, which the owner calls often, for example once per frame.
///
/// All methods, the destructor included, are called on one thread at a time, and so are those of the transports that it
/// makes. Payloads are immutable and may be read on any thread for as long as they are kept. What one `pump` does is bounded:
/// `maxPumpBytes` of messages are taken at most, with the hash over what became whole; on a headset a frame is dearer than
/// that, so engines rather run `StreamThread`.
class TERRAPORTCORE_API SceneStream final : public ISceneStream {
 public:
  /// Make a stream; it connects at the first `pump`.
  /// `chance` gives numbers in [0, 1) for the waits between attempts; null takes a generator of its own.
  /// Errors: `invalid_url`, `invalid_field`.
  static Result<std::unique_ptr<SceneStream>> make(
      const StreamOptions& options, std::shared_ptr<TransportFactory> transports, double (*chance)() = nullptr);

  ~SceneStream() override;
  SceneStream(const SceneStream&) = delete;
  SceneStream& operator=(const SceneStream&) = delete;

  /// Do everything that is due: connect, receive, verify, answer, aim (at most ten times a second), grant credit, connect
  /// again. `nowMs` is any clock that never runs back, milliseconds; `land` counts from the time of the last `pump`.
  void pump(double nowMs);

  /// Most bytes of messages that one `pump` takes in; at least one message is taken.
  void setMaxPumpBytes(std::size_t bytes);

  std::int64_t land(const Vec3& position, double radiusM, const LandOptions& options) override;
  void aim(const Vec3& position, double radiusM, const std::optional<double>& coarseRadiusM = std::nullopt) override;
  Result<std::uint64_t> pick(const Vec3& origin, const std::optional<Vec3>& direction) override;
  Result<std::uint64_t> joinGroup(const std::string& group, GroupRole role, const std::string& ownName) override;
  void leaveGroup() override;
  Result<std::uint64_t> gather(const Vec3& position, double radiusM, const std::optional<double>& innerRadiusM,
      const std::optional<std::uint32_t>& deadlineMs) override;
  void arrive(std::uint32_t gathering, GroupArrival how) override;
  bool tryNextEvent(StreamEvent& event) override;
  SharedPayload payload(std::uint32_t segment) const override;
  StreamStats stats() const override;
  void reconnect(const std::string& token) override;
  void close() override;

 private:
  struct Impl;
  explicit SceneStream(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace terraport
