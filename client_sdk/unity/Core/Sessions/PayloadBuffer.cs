using System.Threading;

namespace Terraport.Sessions
{
    /// <summary>
    /// The bytes of one payload in a pooled array, counted by those who use them: the cache, and everybody who has pinned it.
    /// </summary>
    public sealed class PayloadBuffer
    {
        private readonly PayloadPool pool;
        // Changed by Interlocked alone: pins are released on decoding threads.
        private int users;

        internal PayloadBuffer(PayloadPool pool, byte[] data)
        {
            this.pool = pool;
            Data = data;
        }

        /// <summary>The array; what counts of it are the first <see cref="Length"/> bytes.</summary>
        public byte[] Data { get; }

        /// <summary>Payload bytes.</summary>
        public int Length { get; private set; }

        /// <summary>Take part in it; from any thread that has it in its hands.</summary>
        public void Retain() { Interlocked.Increment(ref users); }

        /// <summary>Give one part back; with the last one the array returns to the pool. From any thread.</summary>
        public void Release()
        {
            if (Interlocked.Decrement(ref users) == 0) pool.Return(this);
        }

        /// <summary>Start a new life with one user; called by the pool alone, while nobody else has the buffer.</summary>
        internal void Begin(int length)
        {
            Length = length;
            users = 1;
        }

        /// <summary>Say how many bytes count; at most those of the array.</summary>
        internal void SetLength(int length) { Length = length; }
    }
}
