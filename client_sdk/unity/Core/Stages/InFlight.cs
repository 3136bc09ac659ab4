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
        /// <summary>Weight of the newest mesh in the guess: an exponential average.</summary>
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

        /// <summary>A segment goes to the decoders.</summary>
        internal void BeginDecode() { decoding++; }

        /// <summary>A decode ended whose mesh is not kept, or which failed.</summary>
        internal void DropDecode() { decoding--; }

        /// <summary>A decode ended, and its mesh waits for its upload.</summary>
        internal void Queue(long bytes)
        {
            decoding--;
            waiting++;
            waitingBytes += bytes;
            guessBytes += GuessShare * (bytes - guessBytes);
        }

        /// <summary>A mesh that waited was uploaded, or let go.</summary>
        internal void Dequeue(long bytes)
        {
            waiting--;
            waitingBytes -= bytes;
        }

        /// <summary>Forget all: what still comes belongs to an older version, and is not counted.</summary>
        internal void Clear()
        {
            // The guess stays: the next version's segments are like these.
            decoding = 0;
            waiting = 0;
            waitingBytes = 0;
        }
    }
}
