using System;
using System.Collections.Generic;

namespace Terraport
{
    /// <summary>
    /// One WebSocket connection, polled: so that a browser's socket, an engine's own or a test can stand in for
    /// <see cref="WebSocketTransport"/>. Nothing here blocks or throws for what the network does.
    /// </summary>
    /// <remarks>All members are called from one thread. Used once: another connection is another transport.</remarks>
    public interface ITransport : IDisposable
    {
        /// <summary>Where it stands.</summary>
        TransportState State { get; }

        /// <summary>The subprotocol that the server chose; null where it chose none.</summary>
        string Subprotocol { get; }

        /// <summary>Why it is closed: the server's close code, 1006 where the connection broke or never came about; else 0.</summary>
        int CloseCode { get; }

        /// <summary>The server's reason, or what broke, for people; may be empty.</summary>
        string CloseReason { get; }

        /// <summary>
        /// Called from any thread whenever something may have changed, so that a pumping thread can sleep in between; may be
        /// null. Set it before <see cref="Open"/>.
        /// </summary>
        Action Changed { get; set; }

        /// <summary>Begin to connect.</summary>
        /// <param name="url">ws or wss.</param>
        /// <param name="subprotocols">To offer, in this order.</param>
        /// <param name="bearerToken">
        /// Sent as the header Authorization; where no header can be set, as a further subprotocol entry
        /// (<see cref="Wire.WireCodec.TokenSubprotocol"/>). Null for none.
        /// </param>
        void Open(Uri url, IReadOnlyList<string> subprotocols, string bearerToken);

        /// <summary>Take the next received message; false where none is here. Release what it gives.</summary>
        bool TryReceive(out TransportMessage message);

        /// <summary>
        /// Hand a binary message over, in order; its bytes must not be changed afterwards. False: not now, the queue is full or nothing
        /// is open.
        /// </summary>
        bool TrySend(ArraySegment<byte> message);

        /// <summary>
        /// Close, after what was handed over has left, and without waiting for the other side's answer. Disposing afterwards
        /// does not cut that short.
        /// </summary>
        void Close(int closeCode, string reason);
    }
}
