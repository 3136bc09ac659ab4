using System;
using System.Collections.Generic;
using Terraport.Sessions;

namespace Terraport
{
    /// <summary>Messages on their way out, in order, no faster than the server allows.</summary>
    internal sealed class Outgoing
    {
        // Before the welcome says what is allowed: hello, and nothing else.
        private const double GreetingPerS = 1;

        private Pacer pacer;
        // Whether the first message that waits has its moment, dueMs: each takes its token from the pacer once.
        private bool isBooked;
        private double dueMs;

        /// <summary>Messages that wait; put new ones here.</summary>
        internal Queue<byte[]> Waiting { get; } = new Queue<byte[]>();

        /// <summary>When the first of those that wait may go; never where none does.</summary>
        internal double DueMs => Waiting.Count == 0 ? double.PositiveInfinity : isBooked ? dueMs : 0;

        /// <summary>Forget what waits: this is a new connection.</summary>
        internal void Begin(double nowMs)
        {
            Waiting.Clear();
            isBooked = false;
            pacer = new Pacer(GreetingPerS, nowMs);
        }

        /// <summary>Pace by what the welcome allows from now on.</summary>
        internal void Allow(double messagesPerS, double nowMs) { pacer = new Pacer(messagesPerS, nowMs); }

        /// <summary>Hand messages to the transport, as many as pace and queue allow now.</summary>
        internal void Send(ITransport transport, double nowMs)
        {
            while (Waiting.Count > 0)
            {
                if (!isBooked)
                {
                    dueMs = nowMs + pacer.Take(nowMs);
                    isBooked = true;
                }
                if (nowMs < dueMs || !transport.TrySend(new ArraySegment<byte>(Waiting.Peek()))) return;
                Waiting.Dequeue();
                isBooked = false;
            }
        }
    }
}
