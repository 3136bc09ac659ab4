using System;

namespace Terraport
{
    /// <summary>One whole WebSocket message, in a buffer that goes back to the transport.</summary>
    public readonly struct TransportMessage
    {
        private readonly ITransportBuffers buffers;

        /// <summary>A message in a buffer of <paramref name="buffers"/>; null where nothing is to be given back.</summary>
        public TransportMessage(ArraySegment<byte> bytes, bool isText, ITransportBuffers buffers)
        {
            Bytes = bytes;
            IsText = isText;
            this.buffers = buffers;
        }

        /// <summary>The message; text as UTF-8, not looked at yet. Valid until <see cref="Release"/>.</summary>
        public ArraySegment<byte> Bytes { get; }

        /// <summary>Whether it came as a text message, which the session refuses: the protocol has none.</summary>
        public bool IsText { get; }

        /// <summary>Return the buffer to its owner, exactly once: a second time it would be in use twice.</summary>
        public void Release()
        {
            if (buffers != null) buffers.Return(Bytes.Array);
        }
    }
}
