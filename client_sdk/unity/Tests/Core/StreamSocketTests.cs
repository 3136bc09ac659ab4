using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.Linq;
using System.Text;
using System.Threading;
using NUnit.Framework;
using Terraport.Wire;

namespace Terraport.Tests
{
    /// <summary>The transport on ClientWebSocket against a server that is written by hand.</summary>
    [TestFixture]
    public class StreamSocketTests
    {
        [Test]
        public void MessagesComeWholeHoweverTheyWereCutAndGoOutInOrder()
        {
            // 1. The server: a text, a binary message in ten frames with pings between them, an empty one; then it listens until a close.
            byte[] large = Enumerable.Range(0, 400000).Select(at => (byte)(at * 31 >> 4)).ToArray();
            var arrived = new List<byte[]>();
            int closedWith = 0;
            using (var server = new StreamSocketServer(101,
                       open =>
                       {
                           open.Send(1, true, Encoding.UTF8.GetBytes("text \u00e9"));
                           for (int at = 0; at < large.Length; at += 40000)
                           {
                               open.Send(at == 0 ? 2 : 0, at + 40000 >= large.Length, large.Skip(at).Take(40000).ToArray());
                               open.Send(9, true, new byte[] { 1 });
                           }
                           open.Send(2, true, new byte[0]);
                           int opcode;
                           for (byte[] data = open.Receive(out opcode);; data = open.Receive(out opcode))
                           {
                               if (opcode == 8) closedWith = data[0] << 8 | data[1];
                               if (opcode == 8) break;
                               arrived.Add(data);
                           }
                           open.SendClose(1000, "");
                       }))
            {
                // 2. Messages come whole, and the pings not at all.
                WebSocketTransport transport = Opened(server, "secret");
                var received = new List<byte[]>();
                var texts = new List<bool>();
                Until(() => Take(transport, received, texts) && received.Count == 3);
                Assert.AreEqual("terraport.v1.msgpack", transport.Subprotocol);
                Assert.AreEqual("text \u00e9", Encoding.UTF8.GetString(received[0]));
                Assert.AreEqual(large, received[1]);
                Assert.AreEqual(0, received[2].Length);
                Assert.AreEqual(new[] { true, false, false }, texts.ToArray());
                // 3. Messages leave in order, from the middle of their arrays; the close goes behind them, though it was asked for at once.
                for (byte number = 0; number < 20; number++)
                {
                    Assert.IsTrue(transport.TrySend(new ArraySegment<byte>(new byte[] { 9, number, 9 }, 1, 1)));
                }
                transport.Close(4400, "malformed");
                transport.Dispose();
                Assert.IsFalse(transport.TrySend(new ArraySegment<byte>(new byte[1])));
                Until(() => transport.State == TransportState.Closed);
                Until(() => closedWith != 0);
                // 4. What the server got, and what the handshake said.
                Assert.AreEqual(Enumerable.Range(0, 20).ToArray(), arrived.Select(data => (int)data[0]).ToArray());
                Assert.AreEqual(4400, closedWith);
                Assert.IsTrue(server.Request.Exists(line => line == "Authorization: Bearer secret"));
                Assert.IsTrue(server.Request.Exists(line => line == "Sec-WebSocket-Protocol: terraport.v1.msgpack"));
            }
        }

        [Test]
        public void TheServersCloseIsToldBehindItsMessages()
        {
            using (var server = new StreamSocketServer(101,
                       open =>
                       {
                           open.Send(2, true, new byte[] { 7 });
                           open.SendClose(4503, "draining");
                           int opcode;
                           open.Receive(out opcode);
                       }))
            {
                WebSocketTransport transport = Opened(server, null);
                Until(() => transport.State == TransportState.Closed);
                Assert.AreEqual(4503, transport.CloseCode);
                Assert.AreEqual("draining", transport.CloseReason);
                TransportMessage message;
                Assert.IsTrue(transport.TryReceive(out message));
                // Closed, and what came before the close can still be taken.
                Assert.AreEqual(7, message.Bytes.Array[message.Bytes.Offset]);
                message.Release();
                Assert.IsFalse(transport.TryReceive(out message));
                Assert.IsFalse(server.Request.Exists(line => line.StartsWith("Authorization", StringComparison.Ordinal)));
            }
        }

        [TestCase(401, 4401)]
        [TestCase(403, 4403)]
        [TestCase(404, 4404)]
        [TestCase(503, 4503)]
        [TestCase(500, 4500)]
        [TestCase(418, 1006)]
        public void ARefusedHandshakeIsTheCloseCodeOfItsStatusWhereThePlatformTellsThat(int status, int closeCode)
        {
            using (var server = new StreamSocketServer(status,
                       open =>
                       {}))
            {
                WebSocketTransport transport = Opened(server, "x");
                Until(() => transport.State == TransportState.Closed);
                // Mono has the status in no text: then it is a connection that never came about.
                bool isStated = transport.CloseReason.Contains("'" + status + "'");
                Assert.AreEqual(isStated ? closeCode : 1006, transport.CloseCode, transport.CloseReason);
                Assert.AreNotEqual("", transport.CloseReason);
            }
        }

        [Test]
        public void ABrokenLineAndNobodyThereAre1006()
        {
            Uri url;
            // A message that never ends, from a line that then breaks.
            using (var server = new StreamSocketServer(101, open => open.Send(2, false, new byte[] { 1 })))
            {
                url = server.Url;
                WebSocketTransport transport = Opened(server, null);
                Until(() => transport.State == TransportState.Closed);
                Assert.AreEqual(1006, transport.CloseCode);
                TransportMessage message;
                Assert.IsFalse(transport.TryReceive(out message));
            }
            var nobody = new WebSocketTransport();
            nobody.Open(url, new[] { "terraport.v1.msgpack" }, null);
            Until(() => nobody.State == TransportState.Closed);
            Assert.AreEqual(1006, nobody.CloseCode);
            Assert.AreNotEqual("", nobody.CloseReason);
        }

        [Test]
        public void AMessageBeyondEveryLimitEndsTheConnectionForGood()
        {
            using (var server = new StreamSocketServer(101,
                       open =>
                       {
                           try
                           {
                               // 10 MiB in one message of many frames.
                               for (int count = 0; count < 40; count++) open.Send(count == 0 ? 2 : 0, false, new byte[262144]);
                           }
                           catch (System.IO.IOException)
                           {
                               // The client has gone, as it should.
                           }
                       }))
            {
                WebSocketTransport transport = Opened(server, null);
                Until(() => transport.State == TransportState.Closed);
                Assert.AreEqual(CloseCodes.TooLarge, transport.CloseCode);
                Assert.AreEqual(AfterClose.Stop, Closes.After(transport.CloseCode));
            }
        }

        [Test]
        public void WhatNobodyTakesIsBounded()
        {
            int sent = 0;
            using (var server = new StreamSocketServer(101,
                       open =>
                       {
                           for (; sent < 400; sent++) open.Send(2, true, new byte[131072]);
                           open.SendClose(1000, "");
                       }))
            {
                WebSocketTransport transport = Opened(server, null);
                Thread.Sleep(700);
                // 4 MiB wait here, and what the kernel's buffers take.
                Assert.Less(sent, 200);
                var received = new List<byte[]>();
                Until(() => Take(transport, received, new List<bool>()) && received.Count == 400);
                Until(() => transport.State == TransportState.Closed);
                Assert.AreEqual(1000, transport.CloseCode);
            }
        }

        [Test]
        public void ATokenThatNoHeaderCanSayIsRefusedHere()
        {
            var transport = new WebSocketTransport();
            transport.Open(new Uri("ws://127.0.0.1:9/"), new[] { "terraport.v1.msgpack" }, "a\r\nb");
            Assert.AreEqual(TransportState.Closed, transport.State);
            Assert.AreEqual(CloseCodes.Unauthorised, transport.CloseCode);
        }

        private static WebSocketTransport Opened(StreamSocketServer server, string token)
        {
            var transport = new WebSocketTransport();
            transport.Open(server.Url, new[] { "terraport.v1.msgpack" }, token);
            return transport;
        }

        private static bool Take(WebSocketTransport transport, List<byte[]> into, List<bool> texts)
        {
            TransportMessage message;
            while (transport.TryReceive(out message))
            {
                into.Add(message.Bytes.ToArray());
                texts.Add(message.IsText);
                message.Release();
            }
            return true;
        }

        private static void Until(Func<bool> condition)
        {
            Stopwatch clock = Stopwatch.StartNew();
            while (!condition())
            {
                Assert.Less(clock.ElapsedMilliseconds, 20000, "it never is so");
                Thread.Sleep(2);
            }
        }
    }
}
