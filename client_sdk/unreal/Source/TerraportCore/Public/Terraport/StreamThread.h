#pragma once

#include "Terraport/Api.h"
#include "Terraport/SceneStream.h"

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

namespace terraport {

/// A `SceneStream` on a thread of its own, so that receiving and hashing cost the frame nothing.
///
/// All methods are called on one thread at a time (the game thread); they take a lock for a moment and never wait for the
/// network. The transports are made, used and destroyed on the stream's own thread.
class TERRAPORTCORE_API StreamThread final : public ISceneStream {
 public:
  /// Start. Errors: as `SceneStream::make`.
  static Result<std::unique_ptr<StreamThread>> make(const StreamOptions& options, std::shared_ptr<TransportFactory> transports);

  /// Says goodbye where `close` was not called, and waits for the thread: some milliseconds.
  ~StreamThread() override;
  StreamThread(const StreamThread&) = delete;
  StreamThread& operator=(const StreamThread&) = delete;

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
  explicit StreamThread(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace terraport
