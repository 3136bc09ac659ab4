using System;
using System.Collections.Generic;
using NUnit.Framework;
using Terraport.Json;
using Terraport.Wire;

namespace Terraport.Tests
{
    /// <summary>Mutilated messages: read, or refused with the one exception that says so.</summary>
    [TestFixture]
    public class WireFuzzTests
    {
        private const int Rounds = 60000;

        [Test]
        public void WhateverTheBytesAreNothingButARefusalComesOfThem()
        {
            var seeds = new List<KeyValuePair<JsonValue, byte[]>>();
            foreach (string kind in new[] { "good", "bad" })
            {
                foreach (string name in WireCorpus.Names(kind))
                {
                    byte[] data;
                    JsonValue facts = WireCorpus.Read(kind, name, out data);
                    if (data.Length < 4096) seeds.Add(new KeyValuePair<JsonValue, byte[]>(facts, data));
                }
            }
            var random = new Random(7);
            int refused = 0;
            for (int round = 0; round < Rounds; round++)
            {
                KeyValuePair<JsonValue, byte[]> seed = seeds[random.Next(seeds.Count)];
                byte[] data = Mutilated(seed.Value, seeds[random.Next(seeds.Count)].Value, random);
                try
                {
                    Decode(seed.Key, data);
                }
                catch (DecodeException)
                {
                    refused++;
                }
            }
            // Neither all nor none: the mutations must reach both outcomes to prove anything.
            Assert.That(refused, Is.InRange(Rounds / 4, Rounds - 1000));
        }

        private static void Decode(JsonValue facts, byte[] data)
        {
            if (facts["kind"].Text == "frame")
            {
                PayloadFrame frame;
                PayloadFrame.TryDecode(new ArraySegment<byte>(data), out frame);
                return;
            }
            Direction direction = facts["direction"].Text == "client_to_server" ? Direction.ClientToServer : Direction.ServerToClient;
            WireMessage message = WireCodec.Decode(new ArraySegment<byte>(data), direction);
            // What is taken can be written.
            if (!(message is UnknownMessage)) WireCodec.Encode(message);
        }

        private static byte[] Mutilated(byte[] from, byte[] donor, Random random)
        {
            var data = (byte[])from.Clone();
            // Cut short, spliced with another message, or a few bytes changed (half of the cases).
            switch (random.Next(4))
            {
                case 0: Array.Resize(ref data, random.Next(data.Length + 1)); break;
                case 1:
                    int cut = random.Next(data.Length + 1);
                    int donorStart = random.Next(donor.Length + 1);
                    Array.Resize(ref data, cut + donor.Length - donorStart);
                    Buffer.BlockCopy(donor, donorStart, data, cut, donor.Length - donorStart);
                    break;
                default:
                    for (int count = random.Next(3); count >= 0 && data.Length > 0; count--)
                    {
                        data[random.Next(data.Length)] = (byte)(random.Next(2) == 0 ? random.Next(256) : 1 << random.Next(8));
                    }
                    break;
            }
            return data;
        }
    }
}
