using System;

namespace Terraport
{
    internal enum TransportState
    {
        Connecting,
        Open,
        Closed,
    }

    /// <summary>One WebSocket connection, polled; opened when it is made.</summary>
    internal interface ITransport : IDisposable
    {
        TransportState State { get; }

        /// <summary>Close code; 1006 where the connection broke or never came about.</summary>
        int CloseCode { get; }

        string CloseReason { get; }

        /// <summary>Take the next message, which is valid until <see cref="Release"/>.</summary>
        bool TryReceive(out ArraySegment<byte> message);

        /// <summary>Give the memory of a message back.</summary>
        void Release(ArraySegment<byte> message);

        /// <summary>Send a binary message, soon.</summary>
        void Send(byte[] message);

        /// <summary>Close, after what was sent before.</summary>
        void Close(int code, string reason);
    }
}
