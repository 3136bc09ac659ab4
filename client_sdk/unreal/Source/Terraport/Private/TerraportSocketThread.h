#pragma once

/**
 * The pace of the engine's WebSockets thread. It looks at its sockets once in `ThreadTargetFrameTimeInSeconds`, 30 times a
 * second unless told otherwise, and takes at most a buffer of 32 KiB from each: one megabyte a second, whatever the line has.
 * The module reads the setting when it is loaded, by whoever wants it first.
 */
namespace TerraportSocketThread
{
/** Between two looks, seconds: 32 MB/s, and next to nothing of a core; 0 would take a whole one. */
constexpr double FrameTimeS = 0.001;

/**
 * Set the pace, in the engine's configuration in memory, where WebSockets is not loaded yet and the project has no setting of
 * its own; log what to write into DefaultEngine.ini where it is too late, or the project's own setting is slow. Game thread.
 */
void Prepare();
} // namespace TerraportSocketThread
