using System;
using System.Collections.Generic;
using System.Net.WebSockets;
using System.Text.RegularExpressions;
using System.Threading;
using System.Threading.Tasks;
using Terraport.Wire;

namespace Terraport
{
    /// <summary>
    /// A connection by the platform's own <see cref="ClientWebSocket"/>, for every platform with threads (not WebGL). Received
    /// messages wait in pooled buffers; what waits is bounded, and beyond it nothing more is taken from the network.
    /// </summary>
    public sealed class WebSocketTransport : ITransport, ITransportBuffers
    {
        /// <summary>Bytes of buffers that wait to be taken, beyond which nothing is received.</summary>
        public const int DefaultMaxWaitingBytes = 4 * 1024 * 1024;

        /// <summary>Messages that wait to be sent; more are refused until some have left.</summary>
        public const int MaxUnsentMessages = 256;

        // A frame of the protocol and one byte, so that one that is too long is seen to be.
        private const int BufferBytes = WireLimits.MaxFrameBytes + 1;
        private const int MaxIdleBuffers = 40;
        private const int GoodbyeMs = 1000;
        private static readonly Regex Status = new Regex("'([45][0-9]{2})'", RegexOptions.CultureInvariant);

        // Guards everything below but the socket: polled from one thread, filled and drained by two tasks.
        private readonly object gate = new object();
        private readonly ClientWebSocket socket = new ClientWebSocket();
        private readonly CancellationTokenSource ended = new CancellationTokenSource();
        private readonly Queue<TransportMessage> received = new Queue<TransportMessage>();
        private readonly Queue<ArraySegment<byte>> unsent = new Queue<ArraySegment<byte>>();
        private readonly Stack<byte[]> idle = new Stack<byte[]>();
        // Signals, not counters: a waiter looks again under the lock after it was woken.
        private readonly SemaphoreSlim hasRoom = new SemaphoreSlim(0);
        private readonly SemaphoreSlim hasUnsent = new SemaphoreSlim(0);
        private readonly int maxWaitingBytes;
        private TransportState state = TransportState.Idle;
        private int waitingBytes;
        private int closeCode;
        private string closeReason = "";
        private int goodbyeCode;
        private string goodbyeReason;

        /// <summary>A transport that is not opened yet.</summary>
        /// <param name="maxWaitingBytes">Bytes of buffers that may wait to be taken.</param>
        public WebSocketTransport(int maxWaitingBytes = DefaultMaxWaitingBytes)
        {
            if (maxWaitingBytes < 1) throw new ArgumentOutOfRangeException("maxWaitingBytes");
            this.maxWaitingBytes = maxWaitingBytes;
        }

        /// <inheritdoc/>
        public TransportState State
        {
            get {
                lock (gate) return state;
            }
        }

        /// <inheritdoc/>
        public string Subprotocol => State == TransportState.Open ? socket.SubProtocol : null;

        /// <inheritdoc/>
        public int CloseCode
        {
            get {
                lock (gate) return closeCode;
            }
        }

        /// <inheritdoc/>
        public string CloseReason
        {
            get {
                lock (gate) return closeReason;
            }
        }

        /// <inheritdoc/>
        public Action Changed { get; set; }

        /// <inheritdoc/>
        public void Open(Uri url, IReadOnlyList<string> subprotocols, string bearerToken)
        {
            lock (gate)
            {
                if (state != TransportState.Idle) throw new InvalidOperationException("a transport is opened once");
                state = TransportState.Connecting;
            }
            try
            {
                foreach (string subprotocol in subprotocols) socket.Options.AddSubProtocol(subprotocol);
                if (!string.IsNullOrEmpty(bearerToken)) socket.Options.SetRequestHeader("Authorization", "Bearer " + bearerToken);
            }
            catch (ArgumentException error)
            {
                // Line ends and the like: no header can say such a token.
                Become(TransportState.Closed, CloseCodes.Unauthorised, "the token cannot be sent: " + error.Message);
                return;
            }
            // On the pool: ConnectAsync resolves names and may block the calling frame for that.
            Task.Run(() => Live(url));
        }

        /// <inheritdoc/>
        public bool TryReceive(out TransportMessage message)
        {
            lock (gate)
            {
                if (received.Count == 0)
                {
                    message = default(TransportMessage);
                    return false;
                }
                message = received.Dequeue();
                // Whole buffers are counted, not messages: that is the memory that is taken.
                waitingBytes -= message.Bytes.Array.Length;
                if (hasRoom.CurrentCount == 0) hasRoom.Release();
                return true;
            }
        }

        /// <inheritdoc/>
        public bool TrySend(ArraySegment<byte> message)
        {
            lock (gate)
            {
                if (state != TransportState.Open || goodbyeCode != 0 || unsent.Count >= MaxUnsentMessages) return false;
                unsent.Enqueue(message);
            }
            hasUnsent.Release();
            return true;
        }

        /// <inheritdoc/>
        public void Close(int code, string reason)
        {
            lock (gate)
            {
                if (goodbyeCode != 0) return;
                goodbyeCode = code;
                goodbyeReason = reason;
                if (state != TransportState.Open)
                    ended.Cancel();
                else
                    ended.CancelAfter(GoodbyeMs);
            }
            hasUnsent.Release();
        }

        /// <inheritdoc/>
        public void Dispose() { Close(Closes.Normal, ""); }

        void ITransportBuffers.Return(byte[] buffer)
        {
            lock (gate)
            {
                // Grown buffers are left to the garbage collector: messages of that length are rare.
                if (buffer.Length == BufferBytes && idle.Count < MaxIdleBuffers) idle.Push(buffer);
            }
        }

        /// <summary>The whole life of the connection, off the thread that polls.</summary>
        private async Task Live(Uri url)
        {
            try
            {
                await socket.ConnectAsync(url, ended.Token);
                Become(TransportState.Open, 0, "");
                Task sending = SendAll();
                // Receiving ends with the connection; sending is then cancelled and awaited, so that the socket is not disposed under it.
                await ReceiveAll();
                ended.Cancel();
                await sending;
            }
            catch (Exception error)
            {
                // Whatever broke, the connection is over; a poll sees how.
                Become(TransportState.Closed, CodeOf(error), TextOf(error));
            }
            finally
            {
                ended.Cancel();
                socket.Dispose();
            }
        }

        private async Task ReceiveAll()
        {
            // Invariant: count bytes of the current message lie in buffer, which nobody else has until it is queued.
            byte[] buffer = Rent();
            int count = 0;
            for (;;)
            {
                // 1. Room for the next piece of the message, up to what a server may send at all.
                if (count == buffer.Length && !TryGrow(ref buffer))
                {
                    Become(TransportState.Closed, CloseCodes.TooLarge, "a message of more than " + count + " bytes");
                    return;
                }
                // 2. One piece: a frame of WebSocket, or as much of it as fits.
                var free = new ArraySegment<byte>(buffer, count, buffer.Length - count);
                WebSocketReceiveResult result = await socket.ReceiveAsync(free, ended.Token);
                // 3. The server's close: what was received before it stays takeable.
                if (result.MessageType == WebSocketMessageType.Close)
                {
                    int code = result.CloseStatus.HasValue ? (int)result.CloseStatus.Value : Closes.Abnormal;
                    Become(TransportState.Closed, code, result.CloseStatusDescription ?? "");
                    if (socket.State != WebSocketState.CloseReceived) return;
                    // The server waits for an answer before it lets the connection go.
                    ended.CancelAfter(GoodbyeMs);
                    await socket.CloseOutputAsync(WebSocketCloseStatus.NormalClosure, "", ended.Token);
                    return;
                }
                count += result.Count;
                // 4. A whole message is queued; its buffer changes hands.
                if (!result.EndOfMessage) continue;
                bool isFull;
                lock (gate)
                {
                    var bytes = new ArraySegment<byte>(buffer, 0, count);
                    received.Enqueue(new TransportMessage(bytes, result.MessageType == WebSocketMessageType.Text, this));
                    waitingBytes += buffer.Length;
                    isFull = waitingBytes >= maxWaitingBytes;
                }
                Notify();
                // 5. Backpressure: while too much waits, nothing is taken from the network, and TCP's window closes.
                while (isFull)
                {
                    await hasRoom.WaitAsync(ended.Token);
                    lock (gate) isFull = waitingBytes >= maxWaitingBytes;
                }
                buffer = Rent();
                count = 0;
            }
        }

        private async Task SendAll()
        {
            try
            {
                for (;;)
                {
                    await hasUnsent.WaitAsync(ended.Token);
                    ArraySegment<byte> next;
                    bool isGoodbye;
                    lock (gate)
                    {
                        // Close releases the semaphore without a message: an empty queue means goodbye, behind all that was queued before.
                        isGoodbye = unsent.Count == 0;
                        next = isGoodbye ? default(ArraySegment<byte>) : unsent.Dequeue();
                    }
                    if (isGoodbye)
                    {
                        await socket.CloseOutputAsync((WebSocketCloseStatus)goodbyeCode, goodbyeReason, ended.Token);
                        return;
                    }
                    await socket.SendAsync(next, WebSocketMessageType.Binary, true, ended.Token);
                }
            }
            catch (Exception)
            {
                // The receiving side sees the same and tells it; without this a half-dead line would wait for its silence.
                ended.Cancel();
            }
        }

        private byte[] Rent() { lock (gate) return idle.Count > 0 ? idle.Pop() : new byte[BufferBytes]; }

        /// <summary>Make room for a longer message, twice as much each time; false beyond what a server may send.</summary>
        private static bool TryGrow(ref byte[] buffer)
        {
            if (buffer.Length > WireLimits.MaxServerMessageBytes) return false;
            Array.Resize(ref buffer, Math.Min(2 * buffer.Length, WireLimits.MaxServerMessageBytes + 1));
            return true;
        }

        private void Become(TransportState next, int code, string reason)
        {
            lock (gate)
            {
                // The first reason counts: what breaks while a connection is torn down says nothing.
                if (state == TransportState.Closed) return;
                state = next;
                closeCode = code;
                closeReason = reason;
            }
            Notify();
        }

        private void Notify()
        {
            // Read once: another thread may clear it between the test and the call.
            Action changed = Changed;
            if (changed != null) changed();
        }

        /// <summary>
        /// The close code that an exception stands for. A refused handshake has its HTTP status in the text only, and on Mono
        /// not even there: that is a connection which never came about.
        /// </summary>
        private static int CodeOf(Exception error)
        {
            for (Exception cause = error; cause != null; cause = cause.InnerException)
            {
                Match match = Status.Match(cause.Message);
                if (cause is WebSocketException && match.Success) return Closes.OfHttpStatus(int.Parse(match.Groups[1].Value));
            }
            return Closes.Abnormal;
        }

        /// <summary>What broke, from the outermost to what lies behind it.</summary>
        private static string TextOf(Exception error)
        {
            string text = error.Message;
            for (Exception cause = error.InnerException; cause != null; cause = cause.InnerException)
            {
                if (!text.Contains(cause.Message)) text += ": " + cause.Message;
            }
            return text;
        }
    }
}
