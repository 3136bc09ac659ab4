using System;
using System.IO;
using Terraport.Json;
using Terraport.Tests;
using Terraport.Wire;

namespace Terraport.Tools
{
    /// <summary>
    /// Runs tests/conformance/wire: good messages and frames must decode to what their .json says, and canonical ones encode
    /// to the very bytes; bad ones must be refused with the error that it names.
    /// </summary>
    internal sealed class WireCorpus
    {
        private readonly string root;

        public WireCorpus(string root) { this.root = root; }

        public int Run()
        {
            var tally = new Tally();
            foreach (string folder in new[] { "good", "bad" })
            {
                string[] paths = Directory.GetFiles(Path.Combine(root, folder), "*.json");
                Array.Sort(paths, StringComparer.Ordinal);
                foreach (string path in paths) tally.Add(folder + "/" + Path.GetFileNameWithoutExtension(path), WhyNot(path));
            }
            return tally.Finish();
        }

        /// <summary>What is wrong with a case; null where it is as it should be.</summary>
        private static string WhyNot(string path)
        {
            // The corpus has texts that are no valid Unicode, and files that are larger than any message.
            JsonValue facts = JsonReader.Read(new ArraySegment<byte>(File.ReadAllBytes(path)));
            ArraySegment<byte> data = Padded(File.ReadAllBytes(Path.ChangeExtension(path, ".bin")), facts);
            try
            {
                return facts["kind"].Text == "frame" ? Frame(data, facts) : Message(data, facts);
            }
            catch (DecodeException error)
            {
                return ErrorDifference(error, facts["error"]);
            }
        }

        private static string Message(ArraySegment<byte> data, JsonValue facts)
        {
            Direction direction = facts["direction"].Text == "client_to_server" ? Direction.ClientToServer : Direction.ServerToClient;
            // 1. Decode, where the case says that it decodes. 2. The same message. 3. The same bytes, where those were canonical.
            WireMessage message = WireCodec.Decode(data, direction);
            if (!facts["error"].IsNull) return "was taken; expected the error " + facts["error"]["code"].Text;
            if (message is UnknownMessage)
            {
                return message.Type == facts["unknown"].Text ? null : "unknown type " + message.Type;
            }
            if (facts["message"].IsNull) return "was taken as " + message.Type + "; expected an unknown type";
            string difference = Difference("message", ReadableForm.Of(message), facts["message"]);
            if (difference != null) return difference;
            bool canonical;
            facts["canonical"].TryFlag(out canonical);
            bool same = Equal(new ArraySegment<byte>(WireCodec.Encode(message)), data);
            return same == canonical ? null : "encodes to " + (same ? "the same bytes" : "other bytes") + ", expected otherwise";
        }

        private static string Frame(ArraySegment<byte> data, JsonValue facts)
        {
            PayloadFrame frame;
            bool isSupported = PayloadFrame.TryDecode(data, out frame);
            if (!facts["error"].IsNull) return "was taken; expected the error " + facts["error"]["code"].Text;
            JsonValue expected = facts["frame"];
            if (!isSupported) return expected["unknown_kind"].IsNull ? "was skipped as of an unknown kind" : null;
            bool isLast;
            expected["last"].TryFlag(out isLast);
            // IsLast follows from the numbers; TryDecode has compared it with the flag.
            if (isLast != frame.IsLast) return "last is " + frame.IsLast;
            string difference = Number("generation", frame.Generation, expected) ?? Number("segment", frame.Segment, expected)
                ?? Number("offset", frame.Offset, expected) ?? Number("total", frame.Total, expected);
            if (difference != null) return difference;
            ArraySegment<byte> chunk = frame.Chunk;
            string hex = BitConverter.ToString(chunk.Array, chunk.Offset, chunk.Count).Replace("-", "").ToLowerInvariant();
            return hex == expected["chunk_hex"].Text ? null : "chunk is " + hex;
        }

        private static string ErrorDifference(DecodeException error, JsonValue expected)
        {
            if (expected.IsNull) return "refused: " + error.Message;
            bool fatal;
            expected["fatal"].TryFlag(out fatal);
            if (error.Code != expected["code"].Text) return "error " + error.Code + ", expected " + expected["code"].Text;
            if (error.IsFatal != fatal) return "fatal is " + error.IsFatal;
            if (error.Field != expected["field"].Text) return "field " + error.Field + ", expected " + expected["field"].Text;
            return Number("generation", error.Generation, expected) ?? Number("request", error.Request, expected);
        }

        private static string Number(string name, long? actual, JsonValue expected)
        {
            long stated;
            bool isStated = expected[name].TryInteger(out stated);
            return actual == (isStated ? (long?)stated : null) ? null : name + " is " + actual + ", expected " + expected[name].Show();
        }

        private static string Difference(string path, JsonValue actual, JsonValue expected)
        {
            double left, right;
            if (actual.TryNumber(out left) && expected.TryNumber(out right))
            {
                // 7 and 7.0 are one number here: which of them a field takes is the codec's business.
                return left.Equals(right) ? null : path + " is " + actual.Show() + ", expected " + expected.Show();
            }
            if (actual.Kind != expected.Kind) return path + " is a " + actual.Kind + ", expected a " + expected.Kind;
            switch (actual.Kind)
            {
                case JsonKind.Text:
                    return actual.Text == expected.Text ? null : path + " is " + actual.Show() + ", expected " + expected.Show();
                case JsonKind.Flag:
                    bool flag, expectedFlag;
                    actual.TryFlag(out flag);
                    expected.TryFlag(out expectedFlag);
                    return flag == expectedFlag ? null : path + " is " + flag;
                case JsonKind.List: return ListDifference(path, actual, expected);
                case JsonKind.Object: return ObjectDifference(path, actual.Members, expected.Members);
                default: return null;
            }
        }

        private static string ListDifference(string path, JsonValue actual, JsonValue expected)
        {
            if (actual.Count != expected.Count) return path + " has " + actual.Count + " items, expected " + expected.Count;
            for (int at = 0; at < actual.Count; at++)
            {
                string difference = Difference(path + "[" + at + "]", actual[at], expected[at]);
                if (difference != null) return difference;
            }
            return null;
        }

        private static string ObjectDifference(string path, JsonObject actual, JsonObject expected)
        {
            // As many, and each of ours among theirs: so none of theirs is missing.
            if (actual.Count != expected.Count) return path + " has " + actual.Count + " keys, expected " + expected.Count;
            for (int at = 0; at < actual.Count; at++)
            {
                JsonValue member;
                string name = actual.NameAt(at);
                if (!expected.TryGet(name, out member)) return path + " has the key " + name;
                string difference = Difference(path + "." + name, actual.ValueAt(at), member);
                if (difference != null) return difference;
            }
            return null;
        }

        private static bool Equal(ArraySegment<byte> left, ArraySegment<byte> right)
        {
            if (left.Count != right.Count) return false;
            for (int at = 0; at < left.Count; at++)
            {
                if (left.Array[left.Offset + at] != right.Array[right.Offset + at]) return false;
            }
            return true;
        }

        private static ArraySegment<byte> Padded(byte[] stored, JsonValue facts)
        {
            // Cases beyond a size limit are stored short, and filled up here.
            long size, filler;
            if (!facts["pad_to"].TryInteger(out size) || size <= stored.Length) return new ArraySegment<byte>(stored);
            facts["pad_byte"].TryInteger(out filler);
            var padded = new byte[size];
            stored.CopyTo(padded, 0);
            for (int at = stored.Length; at < size; at++) padded[at] = (byte)filler;
            return new ArraySegment<byte>(padded);
        }
    }
}
