using System;
using System.Collections.Generic;
using Terraport.Wire;

namespace Terraport.Tests
{
    /// <summary>One connection of a <see cref="StreamFakeNetwork"/>. Safe from any thread.</summary>
    internal sealed class StreamFakeTransport : ITransport, ITransportBuffers
    {
        internal readonly StreamAnsweringServer Server;
        internal readonly List<double> SentAtMs = new List<double>();
        internal Uri Url;
        internal string Token;
        internal int ClosedByClientWith;
        /// <summary>Buffers that were handed out and not returned; 0 at the end of every test.</summary>
        internal int Lent;
        internal bool IsDisposed;
        // Where set, the server says nothing any more.
        internal bool IsSilent;
        /// <summary>Where set, the line takes no message: its queue is full.</summary>
        internal bool TakesNothing;
        // Called before a frame is handed over.
        internal Action FrameComes;

        private readonly StreamFakeNetwork network;
        private readonly object gate = new object();
        private readonly Queue<byte[]> down = new Queue<byte[]>();
        private TransportState state;

        internal StreamFakeTransport(StreamFakeNetwork network)
        {
            this.network = network;
            Server = new StreamAnsweringServer(network.Scene);
        }

        public TransportState State
        {
            get {
                lock (gate) return state;
            }
        }

        public string Subprotocol { get; private set; }

        public int CloseCode { get; private set; }

        public string CloseReason { get; private set; }

        public Action Changed { get; set; }

        public void Open(Uri url, IReadOnlyList<string> subprotocols, string bearerToken)
        {
            Url = url;
            Token = bearerToken;
            Subprotocol = subprotocols[0];
            lock (gate) state = network.IsDeaf ? TransportState.Connecting : TransportState.Open;
            if (network.RefuseWith == 0) return;
            if (network.RefuseError != null) down.Enqueue(WireCodec.Encode(network.RefuseError));
            Break(network.RefuseWith, network.RefuseReason);
        }

        public bool TryReceive(out TransportMessage message)
        {
            lock (gate)
            {
                byte[] data = down.Count > 0 ? down.Dequeue() : null;
                if (data == null && state == TransportState.Open && !IsSilent) data = Server.Next();
                message = default(TransportMessage);
                if (data == null) return false;
                if (data.Length > 0 && data[0] < 0x80 && FrameComes != null) FrameComes();
                Lent++;
                message = new TransportMessage(new ArraySegment<byte>(data), false, this);
                return true;
            }
        }

        public bool TrySend(ArraySegment<byte> message)
        {
            lock (gate)
            {
                if (state != TransportState.Open || TakesNothing) return false;
                var data = new byte[message.Count];
                Buffer.BlockCopy(message.Array, message.Offset, data, 0, data.Length);
                Server.Receive(data);
                SentAtMs.Add(network.NowMs);
            }
            // Outside the lock: the stream may pump from within.
            Action changed = Changed;
            if (changed != null) changed();
            return true;
        }

        public void Close(int closeCode, string reason)
        {
            lock (gate)
            {
                if (ClosedByClientWith == 0) ClosedByClientWith = closeCode;
                state = TransportState.Closed;
            }
        }

        public void Dispose() { IsDisposed = true; }

        public void Return(byte[] buffer) { lock (gate) Lent--; }

        /// <summary>Close from the server's side, or break.</summary>
        internal void Break(int closeCode, string reason = "")
        {
            lock (gate)
            {
                state = TransportState.Closed;
                CloseCode = closeCode;
                CloseReason = reason;
            }
            Action changed = Changed;
            if (changed != null) changed();
        }

        /// <summary>Messages on the way to the client.</summary>
        internal int Left
        {
            get {
                lock (gate) return down.Count;
            }
        }

        /// <summary>Put bytes on the way to the client.</summary>
        internal void Inject(byte[] data) { lock (gate) down.Enqueue(data); }
    }
}
