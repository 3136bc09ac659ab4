#if UNITY_WEBGL && !UNITY_EDITOR
using System;
using System.Collections.Generic;
using System.Runtime.InteropServices;
using System.Text;
using Terraport.Wire;

namespace Terraport.Unity
{
    /// <summary>
    /// The browser's own WebSocket, polled. A browser lets nobody set headers: the token goes as a further subprotocol entry.
    /// </summary>
    public sealed class WebGlTransport : ITransport, ITransportBuffers
    {
        private const int MaxTextBytes = 512;
        private const int MaxSpares = 8;

        private readonly Stack<byte[]> spares = new Stack<byte[]>();
        private readonly byte[] text = new byte[MaxTextBytes];
        // Number of the socket in the page's script; 0 before it is opened and after it was let go.
        private int id;

        /// <inheritdoc/>
        public TransportState State => id == 0 ? TransportState.Idle : (TransportState)TerraportSocketState(id);

        /// <inheritdoc/>
        public string Subprotocol
        {
            get {
                string name = State == TransportState.Open ? TextOf(1) : "";
                return name.Length == 0 ? null : name;
            }
        }

        /// <inheritdoc/>
        public int CloseCode => State == TransportState.Closed ? TerraportSocketCloseCode(id) : 0;

        /// <inheritdoc/>
        public string CloseReason => id == 0 ? "" : TextOf(0);

        /// <inheritdoc/>
        public Action Changed { get; set; }

        /// <inheritdoc/>
        public void Open(Uri url, IReadOnlyList<string> subprotocols, string bearerToken)
        {
            StringBuilder names = new StringBuilder();
            for (int at = 0; at < subprotocols.Count; at++)
            {
                // One string for the script, which splits it again: subprotocol names have no commas.
                names.Append(at == 0 ? "" : ",").Append(subprotocols[at]);
            }
            if (!string.IsNullOrEmpty(bearerToken))
            {
                names.Append(names.Length == 0 ? "" : ",").Append(WireCodec.TokenSubprotocol(bearerToken));
            }
            id = TerraportSocketOpen(url.AbsoluteUri, names.ToString());
        }

        /// <inheritdoc/>
        public bool TryReceive(out TransportMessage message)
        {
            int length = id == 0 ? -1 : TerraportSocketNextLength(id);
            if (length < 0)
            {
                message = default(TransportMessage);
                return false;
            }
            // The script copies the message into it: memory of the page is not ours to keep.
            byte[] buffer = Rent(length);
            bool isText = TerraportSocketTake(id, buffer) == 1;
            message = new TransportMessage(new ArraySegment<byte>(buffer, 0, length), isText, this);
            return true;
        }

        /// <inheritdoc/>
        public bool TrySend(ArraySegment<byte> message)
        {
            if (State != TransportState.Open)
            {
                return false;
            }
            byte[] whole = message.Array;
            // The script reads from the start of the array.
            if (message.Offset != 0)
            {
                whole = new byte[message.Count]; // Messages that are sent are small, and rarely lie elsewhere than at the start.
                Buffer.BlockCopy(message.Array, message.Offset, whole, 0, message.Count);
            }
            return TerraportSocketSend(id, whole, message.Count) == 1;
        }

        /// <inheritdoc/>
        public void Close(int closeCode, string reason)
        {
            if (id != 0)
            {
                TerraportSocketClose(id, closeCode, reason ?? "");
            }
        }

        /// <inheritdoc/>
        public void Return(byte[] buffer)
        {
            if (spares.Count < MaxSpares)
            {
                spares.Push(buffer);
            }
        }

        /// <inheritdoc/>
        public void Dispose()
        {
            if (id != 0)
            {
                // Closed, then let go: the page's script keeps a socket until it is told.
                TerraportSocketClose(id, 1000, "");
                TerraportSocketForget(id);
                id = 0;
            }
        }

        private byte[] Rent(int length)
        {
            // The newest spare or none: messages of one kind come in runs.
            if (spares.Count > 0 && spares.Peek().Length >= length)
            {
                return spares.Pop();
            }
            return new byte[Math.Max(length, 4096)];
        }

        private string TextOf(int which) { return Encoding.UTF8.GetString(text, 0, TerraportSocketText(id, which, text, text.Length)); }

        [DllImport("__Internal")]
        private static extern int TerraportSocketOpen(string url, string protocols);

        [DllImport("__Internal")]
        private static extern int TerraportSocketState(int id);

        [DllImport("__Internal")]
        private static extern int TerraportSocketCloseCode(int id);

        [DllImport("__Internal")]
        private static extern int TerraportSocketText(int id, int which, byte[] buffer, int capacity);

        [DllImport("__Internal")]
        private static extern int TerraportSocketNextLength(int id);

        [DllImport("__Internal")]
        private static extern int TerraportSocketTake(int id, byte[] buffer);

        [DllImport("__Internal")]
        private static extern int TerraportSocketSend(int id, byte[] message, int length);

        [DllImport("__Internal")]
        private static extern void TerraportSocketClose(int id, int code, string reason);

        [DllImport("__Internal")]
        private static extern void TerraportSocketForget(int id);
    }
}
#endif
