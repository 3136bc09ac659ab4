using System;
using System.Collections.Generic;
using System.IO;
using System.Net;
using System.Net.Sockets;
using System.Security.Cryptography;
using System.Text;
using System.Threading;

namespace Terraport.Tests
{
    /// <summary>A WebSocket server for one connection, by hand, so that a test decides about every byte of it.</summary>
    internal sealed class StreamSocketServer : IDisposable
    {
        private readonly TcpListener listener = new TcpListener(IPAddress.Loopback, 0);
        private readonly Thread thread;
        private volatile Exception failure;

        /// <param name="status">Answer to the handshake: 101, or a refusal.</param>
        /// <param name="act">What it does with an open connection.</param>
        internal StreamSocketServer(int status, Action<StreamSocketServer> act)
        {
            listener.Start();
            thread = new Thread(() => Run(status, act)) { IsBackground = true };
            thread.Start();
        }

        internal Uri Url => new Uri("ws://127.0.0.1:" + ((IPEndPoint)listener.LocalEndpoint).Port + "/stream");

        /// <summary>The request's header lines.</summary>
        internal List<string> Request { get; } = new List<string>();

        private NetworkStream Stream { get; set; }

        public void Dispose()
        {
            listener.Stop();
            thread.Join(5000);
            if (failure != null) throw new InvalidOperationException("the server failed", failure);
        }

        /// <summary>Send one WebSocket frame, not masked, as servers do.</summary>
        internal void Send(int opcode, bool isLast, byte[] data)
        {
            var head = new List<byte> { (byte)(opcode | (isLast ? 0x80 : 0)) };
            // RFC 6455, section 5.2: 7, 16 or 64 bits of length.
            if (data.Length < 126)
                head.Add((byte)data.Length);
            else if (data.Length < 65536)
                head.AddRange(new byte[] { 126, (byte)(data.Length >> 8), (byte)data.Length });
            else
            {
                head.Add(127);
                for (int shift = 56; shift >= 0; shift -= 8) head.Add((byte)((long)data.Length >> shift));
            }
            Stream.Write(head.ToArray(), 0, head.Count);
            Stream.Write(data, 0, data.Length);
        }

        internal void SendClose(int code, string reason)
        {
            byte[] text = Encoding.UTF8.GetBytes(reason);
            var data = new byte[2 + text.Length];
            data[0] = (byte)(code >> 8);
            data[1] = (byte)code;
            text.CopyTo(data, 2);
            Send(8, true, data);
        }

        /// <summary>The next frame of the client, its mask taken off; pings and pongs are left out.</summary>
        internal byte[] Receive(out int opcode)
        {
            for (;;)
            {
                opcode = ReadByte() & 0x0f;
                long length = ReadByte() & 0x7f;
                // Clients always mask, so four bytes of mask follow the length.
                int more = length == 126 ? 2 : length == 127 ? 8 : 0;
                if (more > 0) length = 0;
                for (; more > 0; more--) length = length << 8 | (uint)ReadByte();
                byte[] mask = ReadBytes(4);
                byte[] data = ReadBytes((int)length);
                for (int index = 0; index < data.Length; index++) data[index] ^= mask[index % 4];
                if (opcode != 9 && opcode != 10) return data;
            }
        }

        private void Run(int status, Action<StreamSocketServer> act)
        {
            try
            {
                using (TcpClient client = listener.AcceptTcpClient())
                {
                    Stream = client.GetStream();
                    for (string line = ReadLine(); line.Length > 0; line = ReadLine()) Request.Add(line);
                    string key =
                        Request.Find(line => line.StartsWith("Sec-WebSocket-Key: ", StringComparison.OrdinalIgnoreCase)).Substring(19);
                    // RFC 6455, section 4.2.2: the client refuses a server that cannot compute it.
                    byte[] hash = SHA1.Create().ComputeHash(Encoding.ASCII.GetBytes(key + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"));
                    string answer = status == 101
                        ? "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: "
                            + Convert.ToBase64String(hash) + "\r\nSec-WebSocket-Protocol: terraport.v1.msgpack\r\n\r\n"
                        : "HTTP/1.1 " + status + " Refused\r\nContent-Length: 0\r\n\r\n";
                    byte[] bytes = Encoding.ASCII.GetBytes(answer);
                    Stream.Write(bytes, 0, bytes.Length);
                    if (status == 101) act(this);
                }
            }
            catch (SocketException)
            {
                // The test ended before anybody connected.
            }
            catch (Exception error)
            {
                failure = error;
            }
        }

        private string ReadLine()
        {
            var line = new StringBuilder();
            for (int next = ReadByte(); next != '\n'; next = ReadByte())
            {
                if (next != '\r') line.Append((char)next);
            }
            return line.ToString();
        }

        private int ReadByte()
        {
            int next = Stream.ReadByte();
            if (next < 0) throw new EndOfStreamException();
            return next;
        }

        private byte[] ReadBytes(int count)
        {
            var data = new byte[count];
            for (int at = 0; at < count;)
            {
                int read = Stream.Read(data, at, count - at);
                if (read == 0) throw new EndOfStreamException();
                at += read;
            }
            return data;
        }
    }
}
