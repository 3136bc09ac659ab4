using System;
using System.Collections.Generic;

namespace Terraport.Sessions
{
    /// <summary>
    /// Buffers for payloads, used again and again. Sizes are rounded up by at most a quarter, so that a buffer fits the next
    /// segment too; what lies idle is bounded. Safe from any thread.
    /// </summary>
    public sealed class PayloadPool
    {
        /// <summary>Idle bytes unless another bound is given: 32 MiB.</summary>
        public const long DefaultMaxIdleBytes = 32L * 1024 * 1024;

        private const int SmallestBytes = 4096;

        // By array length. Also the lock: buffers come back from any thread.
        private readonly Dictionary<int, Stack<PayloadBuffer>> idle = new Dictionary<int, Stack<PayloadBuffer>>();
        private readonly long maxIdleBytes;
        private long idleBytes;

        /// <summary>An empty pool.</summary>
        /// <param name="maxIdleBytes">Bytes that may lie idle; 0 keeps none.</param>
        public PayloadPool(long maxIdleBytes = DefaultMaxIdleBytes)
        {
            if (maxIdleBytes < 0) throw new ArgumentOutOfRangeException("maxIdleBytes");
            this.maxIdleBytes = maxIdleBytes;
        }

        /// <summary>Bytes that lie idle now.</summary>
        public long IdleBytes
        {
            get {
                lock (idle) return idleBytes;
            }
        }

        /// <summary>Take a buffer of at least this length, which its user owns; its bytes are left over from before.</summary>
        public PayloadBuffer Rent(int length)
        {
            int size = SizeFor(length);
            PayloadBuffer buffer = null;
            lock (idle)
            {
                Stack<PayloadBuffer> stack;
                if (idle.TryGetValue(size, out stack) && stack.Count > 0)
                {
                    buffer = stack.Pop();
                    idleBytes -= size;
                }
            }
            // Outside the lock: clearing a large array takes time.
            if (buffer == null) buffer = new PayloadBuffer(this, new byte[size]);
            buffer.Begin(length);
            return buffer;
        }

        /// <summary>Take back a buffer that nobody uses any more; called by its last release, on whatever thread.</summary>
        internal void Return(PayloadBuffer buffer)
        {
            int size = buffer.Data.Length;
            lock (idle)
            {
                // Beyond the bound the buffer is left to the garbage collector.
                if (idleBytes + size > maxIdleBytes) return;
                Stack<PayloadBuffer> stack;
                if (!idle.TryGetValue(size, out stack))
                {
                    stack = new Stack<PayloadBuffer>();
                    idle.Add(size, stack);
                }
                stack.Push(buffer);
                idleBytes += size;
            }
        }

        /// <summary>The next of four sizes per power of two.</summary>
        internal static int SizeFor(int length)
        {
            if (length <= SmallestBytes) return SmallestBytes;
            int power = SmallestBytes;
            while (2L * power < length) power *= 2;
            int quarter = power / 4;
            return power + (length - power + quarter - 1) / quarter * quarter;
        }
    }
}
