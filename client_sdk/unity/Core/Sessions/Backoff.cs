using System;

namespace Terraport.Sessions
{
    /// <summary>
    /// How long to wait before connecting again (wire protocol, 10.1): 0.5 s, then twice as long each time up to 30 s, each
    /// wait multiplied by a random number in [0.5, 1], so that the clients of a restarted server do not all come back in the
    /// same moment.
    /// </summary>
    public static class Backoff
    {
        private const double FirstWaitMs = 500;
        private const double LongestWaitMs = 30000;

        /// <summary>Milliseconds to wait before an attempt.</summary>
        /// <param name="attempt">0 for the first one after the loss.</param>
        /// <param name="chance">A number in [0, 1].</param>
        public static double WaitMs(int attempt, double chance)
        {
            // At most 2^16: the shift must not overflow, and the bound is passed long before.
            double doubled = FirstWaitMs * (1 << Math.Min(Math.Max(attempt, 0), 16));
            return Math.Min(LongestWaitMs, doubled) * (0.5 + 0.5 * chance);
        }
    }
}
