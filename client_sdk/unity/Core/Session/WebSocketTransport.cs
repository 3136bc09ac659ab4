using System;
using System.Collections.Generic;
using System.Net.WebSockets;
using System.Text.RegularExpressions;
using System.Threading;
using System.Threading.Tasks;
using Terraport.Wire;

namespace Terraport
{
    /// <summary>A connection by <see cref="ClientWebSocket"/>: every platform but WebGL. Two tasks of the pool receive and send.</summary>
    internal sealed class WebSocketTransport : ITransport
    {
        private const int MaxMessageBytes = 8 * 1024 * 1024, MaxSpares = 40, GoodbyeMs = 1000, PauseMs = 5;

        /// <summary>Bytes that may wait to be taken: beyond it nothing more is taken from the network. Credit keeps payload far below.</summary>
        private const long MaxWaitingBytes = 256L << 20;

        private static readonly Regex Status = new Regex("'([45][0-9]{2})'", RegexOptions.CultureInvariant);

        // Guards everything below but the socket.
        private readonly object gate = new object();
        private readonly ClientWebSocket socket = new ClientWebSocket();
        private readonly CancellationTokenSource ended = new CancellationTokenSource();
        private readonly Queue<ArraySegment<byte>> received = new Queue<ArraySegment<byte>>();
        private readonly Queue<byte[]> unsent = new Queue<byte[]>();
        private readonly Stack<byte[]> spares = new Stack<byte[]>();
        private readonly SemaphoreSlim hasUnsent = new SemaphoreSlim(0);
        private TransportState state = TransportState.Connecting;
        private long waitingBytes;
        private int closeCode, goodbyeCode;
        private string closeReason = "", goodbyeReason;

        /// <summary>Begin to connect.</summary>
        /// <param name="url">ws or wss.</param>
        /// <param name="token">Bearer token; null or empty for none.</param>
        internal WebSocketTransport(Uri url, string token)
        {
            try
            {
                socket.Options.AddSubProtocol(ClientMessages.Subprotocol);
                if (!string.IsNullOrEmpty(token)) socket.Options.SetRequestHeader("Authorization", "Bearer " + token);
            }
            catch (ArgumentException error)
            {
                // Line ends and the like are not allowed in a header.
                Become(TransportState.Closed, CloseCodes.Unauthorised, "the token cannot be sent: " + error.Message);
                return;
            }
            // On the pool: ConnectAsync resolves names, which may block.
            Task.Run(() => LiveAsync(url));
        }

        public TransportState State
        {
            get {
                lock (gate) return state;
            }
        }

        public int CloseCode => closeCode;

        public string CloseReason => closeReason;

        public bool TryReceive(out ArraySegment<byte> message)
        {
            lock (gate)
            {
                message = received.Count > 0 ? received.Dequeue() : default;
                waitingBytes -= message.Count;
                return message.Array != null;
            }
        }

        public void Release(ArraySegment<byte> message)
        {
            lock (gate)
            {
                // Longer buffers are left to the garbage collector: messages of that length are rare.
                if (message.Array.Length == Frame.MaxBytes && spares.Count < MaxSpares) spares.Push(message.Array);
            }
        }

        public void Send(byte[] message)
        {
            lock (gate) unsent.Enqueue(message);
            hasUnsent.Release();
        }

        public void Close(int code, string reason)
        {
            lock (gate)
            {
                if (goodbyeCode != 0) return;
                goodbyeCode = code;
                goodbyeReason = reason;
                if (state == TransportState.Open)
                    ended.CancelAfter(GoodbyeMs);
                else
                    ended.Cancel();
            }
            hasUnsent.Release();
        }

        public void Dispose() { Close(CloseCodes.Normal, ""); }

        /// <summary>The whole life of the connection.</summary>
        private async Task LiveAsync(Uri url)
        {
            try
            {
                await socket.ConnectAsync(url, ended.Token).ConfigureAwait(false);
                if (socket.SubProtocol != ClientMessages.Subprotocol)
                    throw new WebSocketException("the server does not speak " + ClientMessages.Subprotocol);
                Become(TransportState.Open, 0, "");
                Task sending = SendAllAsync();
                await ReceiveAllAsync().ConfigureAwait(false);
                // Sending is ended and awaited, so that the socket is not disposed of while it is used.
                ended.Cancel();
                await sending.ConfigureAwait(false);
            }
            catch (Exception error)
            {
                // Whatever broke, the connection is over.
                Become(TransportState.Closed, CodeOf(error), (error.InnerException ?? error).Message);
            }
            finally
            {
                ended.Cancel();
                socket.Dispose();
            }
        }

        private async Task ReceiveAllAsync()
        {
            byte[] buffer = Rent();
            for (int count = 0;;)
            {
                // 1. Room for the next piece of the message, up to what a service may send at all.
                if (count == buffer.Length)
                {
                    if (count >= MaxMessageBytes) throw new WebSocketException("got a message of more than " + count + " bytes");
                    Array.Resize(ref buffer, Math.Min(2 * count, MaxMessageBytes));
                }
                var free = new ArraySegment<byte>(buffer, count, buffer.Length - count);
                WebSocketReceiveResult result = await socket.ReceiveAsync(free, ended.Token).ConfigureAwait(false);
                // 2. The close of the service: what was received before stays takeable.
                if (result.MessageType == WebSocketMessageType.Close)
                {
                    Become(TransportState.Closed, (int?)result.CloseStatus ?? CloseCodes.Abnormal, result.CloseStatusDescription ?? "");
                    if (socket.State != WebSocketState.CloseReceived) return;
                    ended.CancelAfter(GoodbyeMs);
                    await socket.CloseOutputAsync(WebSocketCloseStatus.NormalClosure, "", ended.Token).ConfigureAwait(false);
                    return;
                }
                if (result.MessageType == WebSocketMessageType.Text)
                    throw new WebSocketException("got a text message, expected binary ones");
                count += result.Count;
                if (!result.EndOfMessage) continue;
                // 3. A whole message; its buffer changes hands.
                bool isFull;
                lock (gate)
                {
                    received.Enqueue(new ArraySegment<byte>(buffer, 0, count));
                    waitingBytes += count;
                    isFull = waitingBytes > MaxWaitingBytes;
                }
                while (isFull)
                {
                    await Task.Delay(PauseMs, ended.Token).ConfigureAwait(false);
                    lock (gate) isFull = waitingBytes > MaxWaitingBytes;
                }
                buffer = Rent();
                count = 0;
            }
        }

        private async Task SendAllAsync()
        {
            try
            {
                for (;;)
                {
                    await hasUnsent.WaitAsync(ended.Token).ConfigureAwait(false);
                    byte[] next = null;
                    lock (gate)
                    {
                        if (unsent.Count > 0) next = unsent.Dequeue();
                    }
                    if (next == null)
                    {
                        // Close wakes without a message, after all that were queued before.
                        await socket.CloseOutputAsync((WebSocketCloseStatus)goodbyeCode, goodbyeReason, ended.Token).ConfigureAwait(false);
                        return;
                    }
                    var message = new ArraySegment<byte>(next);
                    await socket.SendAsync(message, WebSocketMessageType.Binary, true, ended.Token).ConfigureAwait(false);
                }
            }
            catch (Exception)
            {
                // The receiving task sees the same and reports it; without this it would wait for a half-dead connection.
                ended.Cancel();
            }
        }

        private byte[] Rent() { lock (gate) return spares.Count > 0 ? spares.Pop() : new byte[Frame.MaxBytes]; }

        private void Become(TransportState next, int code, string reason)
        {
            lock (gate)
            {
                // The first reason counts: what breaks while a connection is closed says nothing.
                if (state == TransportState.Closed) return;
                closeCode = code;
                closeReason = reason;
                state = next;
            }
        }

        /// <summary>The close code of an exception. A refused handshake has its HTTP status in the text alone, and on Mono not even there.</summary>
        private static int CodeOf(Exception error)
        {
            for (Exception cause = error; cause != null; cause = cause.InnerException)
            {
                Match match = Status.Match(cause.Message);
                if (cause is WebSocketException && match.Success) return CloseCodes.OfHttpStatus(int.Parse(match.Groups[1].Value));
            }
            return CloseCodes.Abnormal;
        }
    }
}
