using System;

namespace Terraport.Sessions
{
    /// <summary>
    /// How fast the client may speak: the server's message rate, kept from this side. A token bucket that stays within so many
    /// messages per second over 10 s; time is an argument.
    /// </summary>
    public sealed class Pacer
    {
        // The wire protocol averages the rate over 10 s (section 12).
        private const double WindowS = 10;

        // Part of the allowance that is used: clocks and batching differ between the two sides.
        private const double Margin = 0.8;

        private readonly double perMs;
        private readonly double capacity;
        private double tokens;
        // When `tokens` was last right, on the caller's clock.
        private double atMs;

        /// <summary>Begin with a full bucket.</summary>
        public Pacer(double messagesPerS, double nowMs)
        {
            double perSUsed = messagesPerS * Margin;
            perMs = perSUsed / 1000;
            capacity = Math.Max(1, perSUsed * WindowS);
            tokens = capacity;
            atMs = nowMs;
        }

        /// <summary>Book one message; milliseconds to wait before sending it, 0 for none.</summary>
        public double Take(double nowMs)
        {
            double passedMs = Math.Max(0, nowMs - atMs);
            // May go below zero: a booked message owes its token, and the next one waits longer.
            tokens = Math.Min(capacity, tokens + passedMs * perMs) - 1;
            atMs = Math.Max(atMs, nowMs);
            return Math.Max(0, -tokens / perMs);
        }
    }
}
