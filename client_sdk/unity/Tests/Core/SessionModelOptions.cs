using System;
using Terraport.Wire;

namespace Terraport.Tests
{
    /// <summary>How a <see cref="SessionModelServer"/> behaves, and a <see cref="SessionPair"/> around it.</summary>
    internal sealed class SessionModelOptions
    {
        internal int MaxHeldSegments = 1000;
        internal bool RefusesPicks;
        internal int MaxChunk = WireLimits.MaxChunkBytes;
        // Chunks of random length where there is one.
        internal Random Random;
        internal long CacheBytes = 1 << 20;
        internal long CreditBytes = 4096;
        internal double ReleaseFactor = 1;
        internal Budgets Budgets;
        // Messages of the server that are on their way before one arrives.
        internal int Lag;
    }
}
