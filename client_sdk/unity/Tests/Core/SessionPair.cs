using System;
using System.Collections.Generic;
using System.Linq;
using NUnit.Framework;
using Terraport.Sessions;
using Terraport.Wire;

namespace Terraport.Tests
{
    /// <summary>An in-memory pair: the client's state machine and the model server, over as many connections as it takes.</summary>
    internal sealed class SessionPair
    {
        internal readonly ClientSession Client;
        internal readonly List<StreamEvent> Events = new List<StreamEvent>();
        // Ids of segments that came whole, in order.
        internal readonly List<uint> Received = new List<uint>();
        // Everything that the client said on any connection.
        internal readonly List<RejectMessage> Rejects = new List<RejectMessage>();
        internal SessionToyScene Scene;
        internal SessionModelServer Server;
        // Changes the bytes of a frame on its way.
        internal Func<byte[], byte[]> Spoil;
        internal bool OffersHeld = true;

        private readonly SessionModelOptions options;
        // Messages on their way: down to the client, up to the server.
        private readonly Queue<byte[]> down = new Queue<byte[]>();
        private readonly Queue<byte[]> up = new Queue<byte[]>();

        internal SessionPair(SessionToyScene scene, SessionModelOptions options = null)
        {
            Scene = scene;
            this.options = options ?? new SessionModelOptions();
            Client = new ClientSession(new SessionOptions {
                Client = "pair",
                Budgets = this.options.Budgets,
                CreditBytes = this.options.CreditBytes,
                ReleaseFactor = this.options.ReleaseFactor,
                CacheBytes = this.options.CacheBytes,
            });
        }

        /// <summary>Begin a connection; nothing flows before <see cref="Step"/>.</summary>
        internal SessionPair Connect()
        {
            Server = new SessionModelServer(Scene, options);
            Client.Connected(OffersHeld);
            return this;
        }

        /// <summary>Lose the connection with everything that was on its way.</summary>
        internal void Disconnect()
        {
            Server = null;
            down.Clear();
            Client.ConnectionLost();
            Collect();
        }

        /// <summary>What the client has to send now.</summary>
        internal List<byte[]> TakeSent()
        {
            Client.TakeMessages(up);
            List<byte[]> sent = up.ToList();
            up.Clear();
            return sent;
        }

        /// <summary>Let one thing happen; whether anything did.</summary>
        internal bool Step()
        {
            Collect();
            if (Server == null) return false;
            List<byte[]> sent = TakeSent();
            int heard = Server.Heard.Count;
            foreach (byte[] data in sent) Server.Receive(data);
            Rejects.AddRange(Server.Heard.Skip(heard).OfType<RejectMessage>());
            byte[] next = Server.Next();
            if (next != null) down.Enqueue(IsFrame(next) && Spoil != null ? Spoil(next) : next);
            bool isBusy = next != null || sent.Count > 0;
            // So many messages are under way before the first arrives: orders cross on the wire as on a long line.
            if (down.Count <= (isBusy ? options.Lag : 0)) return isBusy;
            Give(down.Dequeue());
            return true;
        }

        /// <summary>Hand a message of the server to the client, in the middle of a larger buffer that is then overwritten.</summary>
        internal void Give(byte[] data)
        {
            var buffer = new byte[data.Length + 5];
            Buffer.BlockCopy(data, 0, buffer, 3, data.Length);
            Client.Receive(new ArraySegment<byte>(buffer, 3, data.Length), false);
            // A session that kept a view of the message would be seen to.
            for (int index = 0; index < buffer.Length; index++) buffer[index] = 0xee;
            Collect();
        }

        /// <summary>Let everything happen that will.</summary>
        /// <param name="flush">Whether aims are sent, as the link would.</param>
        internal void Settle(bool flush = false)
        {
            for (int steps = 0; Step(); steps++)
            {
                if (flush) Client.FlushAim();
                Assert.Less(steps, 200000, "it never settles");
            }
        }

        /// <summary>Let things happen until something is so.</summary>
        internal void Until(Func<bool> condition)
        {
            for (int steps = 0; !condition(); steps++)
            {
                Step();
                Assert.Less(steps, 200000, "it never is so");
            }
        }

        internal List<StreamEvent> Of(StreamEventKind kind)
        {
            Collect();
            return Events.FindAll(streamEvent => streamEvent.Kind == kind);
        }

        /// <summary>A copy of a held payload; null where it is not held.</summary>
        internal byte[] Payload(uint segment)
        {
            PinnedPayload pin;
            if (!Client.Cache.TryPin(segment, out pin)) return null;
            byte[] copy = pin.Bytes.ToArray();
            pin.Dispose();
            return copy;
        }

        internal static bool IsFrame(byte[] data) { return data.Length > 0 && data[0] > 0 && data[0] < 0x20; }

        /// <summary>Flip a bit of the last byte of a frame.</summary>
        internal static byte[] Flipped(byte[] data)
        {
            var spoilt = (byte[])data.Clone();
            spoilt[spoilt.Length - 1] ^= 1;
            return spoilt;
        }

        internal static uint SegmentOf(byte[] frame)
        {
            PayloadFrame decoded;
            PayloadFrame.TryDecode(new ArraySegment<byte>(frame), out decoded);
            return decoded.Segment;
        }

        private void Collect()
        {
            StreamEvent next;
            while (Client.TryNextEvent(out next))
            {
                Events.Add(next);
                if (next.Kind == StreamEventKind.Arrived) Received.Add(next.Facts.Segment);
            }
        }
    }
}
