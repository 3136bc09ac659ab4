namespace Terraport
{
    /// <summary>
    /// How much is between a payload and the GPU: segments being decoded, and meshes waiting for their upload. There is always
    /// room for one.
    /// </summary>
    internal sealed class InFlight
    {
        /// <summary>
        /// GPU bytes that a segment is taken to have until some were decoded: between vertex colours and a large texture.
        /// </summary>
        private const double FirstGuessBytes = 6.0 * 1024 * 1024;
        /// <summary>How fast the guess follows what came.</summary>
        private const double GuessShare = 0.25;

        private readonly int maxCount;
        private readonly long maxBytes;
        private int decoding;
        private int waiting;
        private long waitingBytes;
        private double guessBytes = FirstGuessBytes;

        internal InFlight(int maxCount, long maxBytes)
        {
            this.maxCount = maxCount;
            this.maxBytes = maxBytes;
        }

        /// <summary>Segments being decoded, or decoded and waiting for their upload.</summary>
        internal int Count => decoding + waiting;

        /// <summary>Whether one more may be decoded: within both bounds, or alone.</summary>
        internal bool HasRoom => Count == 0 || (Count < maxCount && waitingBytes + (decoding + 1) * guessBytes <= maxBytes);

        /// <summary>A segment was asked for.</summary>
        internal void BeginDecode() { decoding++; }

        /// <summary>It came, or not; it is not kept.</summary>
        internal void DropDecode() { decoding--; }

        /// <summary>It came, and waits.</summary>
        internal void Queue(long bytes)
        {
            decoding--;
            waiting++;
            waitingBytes += bytes;
            guessBytes += GuessShare * (bytes - guessBytes);
        }

        /// <summary>It waits no longer.</summary>
        internal void Dequeue(long bytes)
        {
            waiting--;
            waitingBytes -= bytes;
        }

        /// <summary>Nothing that was asked for will be taken any more.</summary>
        internal void Clear()
        {
            // The guess stays: the next version's segments are like these.
            decoding = 0;
            waiting = 0;
            waitingBytes = 0;
        }
    }
}
