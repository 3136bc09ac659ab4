using System;
using System.Collections.Generic;
using System.Text;
using NUnit.Framework;
using Terraport.Json;
using Terraport.Wire;

namespace Terraport.Tests
{
    /// <summary>The wire corpus, every file of it, both ways. All that differs is told at once.</summary>
    [TestFixture]
    public class WireCorpusTests
    {
        [Test]
        public void GoodMessagesAreReadAndWrittenBack() { RunAll("good", 140); }

        [Test]
        public void BadMessagesAreRefusedWithTheRightCodeAndField() { RunAll("bad", 400); }

        private static void RunAll(string kind, int fewest)
        {
            List<string> names = WireCorpus.Names(kind);
            Assert.Greater(names.Count, fewest);
            var wrong = new StringBuilder();
            foreach (string name in names)
            {
                byte[] data;
                JsonValue facts = WireCorpus.Read(kind, name, out data);
                string difference;
                try
                {
                    difference = Compare(facts, data);
                }
                catch (DecodeException error)
                {
                    difference = CompareError(facts["error"], error);
                }
                if (difference != null) wrong.Append("\n").Append(name).Append(": ").Append(difference);
            }
            Assert.AreEqual("", wrong.ToString());
        }

        /// <summary>What differs in a case that decodes; null where nothing does.</summary>
        private static string Compare(JsonValue facts, byte[] data)
        {
            if (facts["kind"].Text == "frame") return CompareFrame(facts, data);
            Direction direction = facts["direction"].Text == "client_to_server" ? Direction.ClientToServer : Direction.ServerToClient;
            WireMessage message = WireCodec.Decode(new ArraySegment<byte>(data), direction);
            if (!facts["error"].IsNull) return "decoded to " + message.Type + ", expected an error";
            if (message is UnknownMessage) return message.Type == facts["unknown"].Text ? null : "unknown " + message.Type;
            if (facts["message"].IsNull) return "known, expected " + facts["unknown"].Show();
            if (!SameTree(ReadableForm.Of(message), facts["message"])) return "got another message";
            byte[] encoded = WireCodec.Encode(message);
            bool isCanonical;
            facts["canonical"].TryFlag(out isCanonical);
            if (Same(encoded, data) != isCanonical) return "re-encoding gives the same bytes: " + !isCanonical;
            // Not canonical bytes give canonical ones, which mean the same.
            WireMessage decodedAgain = WireCodec.Decode(new ArraySegment<byte>(encoded), direction);
            return Same(WireCodec.Encode(decodedAgain), encoded) ? null : "not the same after a second way";
        }

        private static string CompareFrame(JsonValue facts, byte[] data)
        {
            // In the middle of a larger buffer, as a pooled one would be.
            var within = new byte[data.Length + 7];
            Buffer.BlockCopy(data, 0, within, 3, data.Length);
            PayloadFrame frame;
            bool isSupported = PayloadFrame.TryDecode(new ArraySegment<byte>(within, 3, data.Length), out frame);
            if (!facts["error"].IsNull) return "decoded, expected an error";
            JsonValue expected = facts["frame"];
            if (!isSupported) return expected["unknown_kind"].Show() == data[0].ToString() ? null : "unknown kind";
            var chunk = new byte[frame.Chunk.Count];
            Buffer.BlockCopy(frame.Chunk.Array, frame.Chunk.Offset, chunk, 0, chunk.Length);
            string hex = BitConverter.ToString(chunk).Replace("-", "").ToLowerInvariant();
            string actual =
                frame.Generation + " " + frame.Segment + " " + frame.Offset + " " + frame.Total + " " + frame.IsLast + " " + hex;
            bool isLast;
            expected["last"].TryFlag(out isLast);
            string stated = expected["generation"].Show() + " " + expected["segment"].Show() + " " + expected["offset"].Show() + " "
                + expected["total"].Show() + " " + isLast + " " + expected["chunk_hex"].Text;
            if (actual != stated) return actual + ", expected " + stated;
            PayloadFrame decodedAgain;
            PayloadFrame.TryDecode(new ArraySegment<byte>(frame.Encode()), out decodedAgain);
            return Same(decodedAgain.Encode(), frame.Encode()) && decodedAgain.Offset == frame.Offset ? null
                                                                                                      : "not the same when written back";
        }

        private static string CompareError(JsonValue expected, DecodeException error)
        {
            if (expected.IsNull) return "refused: " + error.Message;
            bool isFatal;
            expected["fatal"].TryFlag(out isFatal);
            string actual = Facts(error.Code, error.IsFatal, error.Field, Number(error.Generation), Number(error.Request));
            string stated =
                Facts(expected["code"].Text, isFatal, expected["field"].Text, Number(expected["generation"]), Number(expected["request"]));
            return actual == stated ? null : actual + ", expected " + stated + ": " + error.Message;
        }

        private static string Facts(string code, bool isFatal, string field, string generation, string request)
        {
            return code + " fatal=" + isFatal + " field=" + field + " generation=" + generation + " request=" + request;
        }

        private static string Number(uint? number) { return number.HasValue ? number.Value.ToString() : ""; }

        private static string Number(JsonValue number) { return number.IsNull ? "" : number.Show(); }

        /// <summary>The same values, whatever the order of members; numbers by value.</summary>
        private static bool SameTree(JsonValue left, JsonValue right)
        {
            double number;
            double otherNumber;
            if (left.TryNumber(out number)) return right.TryNumber(out otherNumber) && number == otherNumber;
            if (left.Kind != right.Kind || left.Count != right.Count) return false;
            switch (left.Kind)
            {
                case JsonKind.Text: return left.Text == right.Text;
                case JsonKind.Flag: return left.Show() == right.Show();
                case JsonKind.List:
                    for (int index = 0; index < left.Count; index++)
                    {
                        if (!SameTree(left[index], right[index])) return false;
                    }
                    return true;
                case JsonKind.Object:
                    for (int index = 0; index < left.Count; index++)
                    {
                        JsonValue member;
                        if (!right.Members.TryGet(left.Members.NameAt(index), out member)) return false;
                        if (!SameTree(left.Members.ValueAt(index), member)) return false;
                    }
                    return true;
                default: return true;
            }
        }

        private static bool Same(byte[] left, byte[] right)
        {
            if (left.Length != right.Length) return false;
            for (int index = 0; index < left.Length; index++)
            {
                if (left[index] != right[index]) return false;
            }
            return true;
        }
    }
}
