using System.Diagnostics;

namespace Terraport
{
    /// <summary>The clock of all streams: monotonic, and the same on every thread of the process.</summary>
    public static class StreamClock
    {
        /// <summary>Milliseconds since some moment that does not change while the process runs.</summary>
        public static double NowMs => Stopwatch.GetTimestamp() * (1000.0 / Stopwatch.Frequency);
    }
}
