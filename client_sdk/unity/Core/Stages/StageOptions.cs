using System;
using System.Diagnostics;

namespace Terraport
{
    /// <summary>How much a <see cref="SceneStage"/> does at once, and keeps. Bounds of 0 or less are refused.</summary>
    public sealed class StageOptions
    {
        /// <summary>
        /// A landing is shown as soon as it is presentable; else <see cref="SceneStage.Show"/> must be called. Default
        /// true.
        /// </summary>
        public bool AutoShow { get; set; } = true;

        /// <summary>
        /// Landings and aims of a scene with a coarser level ask for a ring of it, to three times the radius, where they name none. Off:
        /// full detail alone. Default true.
        /// </summary>
        public bool ShowsCoarse { get; set; } = true;

        /// <summary>
        /// GPU bytes of segments that are neither shown nor of the newest plan (an aim brought them). Default
        /// 96 MiB.
        /// </summary>
        public long SpareGpuBytes { get; set; } = 96L * 1024 * 1024;

        /// <summary>Segments that are being decoded, or decoded and not uploaded, at a time. Default 16.</summary>
        public int MaxInFlight { get; set; } = 16;

        /// <summary>GPU bytes of those, as far as can be told before they are decoded. Default 64 MiB.</summary>
        public long MaxInFlightBytes { get; set; } = 64L * 1024 * 1024;

        /// <summary>
        /// Bytes that one frame hands to the renderer, however fast it takes them: drivers put work off to a frame in which nobody
        /// measures it. The mesh that passes the bound is still uploaded. Default 6 MiB.
        /// </summary>
        public long MaxFrameUploadBytes { get; set; } = 6L * 1024 * 1024;

        /// <summary>Faces of one block of the base (<see cref="ISceneRenderer.PrepareBase"/>). Default 4096.</summary>
        public int BaseBlockFaces { get; set; } = 4096;

        /// <summary>A clock that never goes back, milliseconds. Default: the machine's.</summary>
        public Func<double> ClockMs { get; set; } = MachineMs;

        /// <exception cref="ArgumentException">A number that bounds nothing, or no clock.</exception>
        internal void Check()
        {
            // 0 bytes of spare memory is a choice; 0 segments in flight would stop the stage.
            bool isBounded = SpareGpuBytes >= 0 && MaxInFlight > 0 && MaxInFlightBytes > 0 && MaxFrameUploadBytes > 0;
            if (!isBounded || BaseBlockFaces <= 0 || ClockMs == null)
            {
                throw new ArgumentException("stage options: expected bounds above 0 (SpareGpuBytes: 0 or more), and a clock");
            }
        }

        private static double MachineMs() { return Stopwatch.GetTimestamp() * (1000.0 / Stopwatch.Frequency); }
    }
}
