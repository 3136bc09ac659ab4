using System;

namespace Terraport
{
    /// <summary>One whole WebSocket message, in a buffer that goes back to the transport.</summary>
    public readonly struct TransportMessage
    {
        private readonly ITransportBuffers buffers;

        /// <summary>Make one; <paramref name="buffers"/> may be null where nothing is to be given back.</summary>
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

        /// <summary>Give the buffer back; once.</summary>
        public void Release()
        {
            if (buffers != null) buffers.Return(Bytes.Array);
        }
    }
}
