#if UNITY_WEBGL && !UNITY_EDITOR
using System;
using System.Runtime.InteropServices;
using System.Text;
using Terraport.Wire;

namespace Terraport.Unity
{
    /// <summary>The browser's own WebSocket, polled. A page cannot set headers: the token goes as a further subprotocol entry.</summary>
    internal sealed class WebGlTransport : ITransport
    {
        private const int MaxReasonBytes = 512;

        // Number of the socket in the page's script.
        private readonly int id;

        internal WebGlTransport(Uri url, string token)
        {
            string entry = string.IsNullOrEmpty(token) ? "" : "," + ClientMessages.TokenPrefix + Base64Url(token);
            id = TerraportSocketOpen(url.AbsoluteUri, ClientMessages.Subprotocol + entry);
        }

        public TransportState State => (TransportState)TerraportSocketState(id);

        public int CloseCode => TerraportSocketCloseCode(id);

        public string CloseReason
        {
            get {
                var text = new byte[MaxReasonBytes];
                return Encoding.UTF8.GetString(text, 0, TerraportSocketReason(id, text, text.Length));
            }
        }

        public bool TryReceive(out ArraySegment<byte> message)
        {
            int length = TerraportSocketNextLength(id);
            message = length < 0 ? default : new ArraySegment<byte>(new byte[length]);
            if (length >= 0) TerraportSocketTake(id, message.Array);
            return length >= 0;
        }

        public void Release(ArraySegment<byte> message) {}

        public void Send(byte[] message) { TerraportSocketSend(id, message, message.Length); }

        public void Close(int code, string reason) { TerraportSocketClose(id, code, reason); }

        public void Dispose()
        {
            TerraportSocketClose(id, CloseCodes.Normal, "");
            // The page's script keeps a socket until then.
            TerraportSocketForget(id);
        }

        private static string Base64Url(string text)
        {
            return Convert.ToBase64String(Encoding.UTF8.GetBytes(text)).TrimEnd('=').Replace('+', '-').Replace('/', '_');
        }

        [DllImport("__Internal")]
        private static extern int TerraportSocketOpen(string url, string protocols);

        [DllImport("__Internal")]
        private static extern int TerraportSocketState(int id);

        [DllImport("__Internal")]
        private static extern int TerraportSocketCloseCode(int id);

        [DllImport("__Internal")]
        private static extern int TerraportSocketReason(int id, byte[] buffer, int capacity);

        [DllImport("__Internal")]
        private static extern int TerraportSocketNextLength(int id);

        [DllImport("__Internal")]
        private static extern void TerraportSocketTake(int id, byte[] buffer);

        [DllImport("__Internal")]
        private static extern void TerraportSocketSend(int id, byte[] message, int length);

        [DllImport("__Internal")]
        private static extern void TerraportSocketClose(int id, int code, string reason);

        [DllImport("__Internal")]
        private static extern void TerraportSocketForget(int id);
    }
}
#endif
