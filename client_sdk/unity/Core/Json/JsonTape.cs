using System;
using System.Globalization;
using System.Text;

namespace Terraport.Json
{
    /// <summary>
    /// A JSON document as a list of nodes over its bytes, in the order in which they stand: the one parser of JSON. A GLB's JSON
    /// chunk is asked for by its nodes, since that allocates nothing once the lists are large enough; everything else becomes
    /// values (<see cref="JsonReader"/>). Anything that is not JSON (RFC 8259) is refused: lenient readers hide damage.
    /// </summary>
    internal sealed class JsonTape
    {
        /// <summary>No node: what a key that is not there gives.</summary>
        internal const int None = -1;

        private const int MostDepth = 64;
        private readonly int[] open = new int[MostDepth];
        private readonly JsonTexts texts = new JsonTexts();
        private readonly JsonNumbers numbers = new JsonNumbers();
        private JsonNode[] nodes = new JsonNode[512];
        private int count;
        private int most;
        private byte[] bytes;
        private int at;
        private int end;

        /// <summary>Read a document; its first node is 0. The bytes must stay as they are while nodes are asked for.</summary>
        /// <param name="source">The array that the text lies in, as UTF-8.</param>
        /// <param name="offset">Where it starts there; offsets in errors count from 0 of the array.</param>
        /// <param name="length">Its bytes.</param>
        /// <param name="maxNodes">Values and keys at most.</param>
        /// <exception cref="JsonException">It is no JSON, nested more than 64 deep, or has too many values.</exception>
        internal void Read(byte[] source, int offset, int length, int maxNodes = int.MaxValue)
        {
            most = maxNodes;
            bytes = source;
            at = offset;
            end = offset + length;
            count = 0;
            if (!Utf8.IsValid(source, offset, length))
            {
                throw Damaged("no UTF-8");
            }
            Parse();
            SkipBlanks();
            if (at != end)
            {
                throw Damaged("something behind the document");
            }
        }

        /// <summary>Let go of the bytes.</summary>
        internal void Release() { bytes = null; }

        internal bool IsObject(int node) { return node >= 0 && nodes[node].Kind == JsonNodeKind.Object; }

        internal bool IsList(int node) { return node >= 0 && nodes[node].Kind == JsonNodeKind.List; }

        internal bool IsText(int node) { return node >= 0 && nodes[node].Kind == JsonNodeKind.Text; }

        internal bool IsNumber(int node) { return node >= 0 && nodes[node].Kind == JsonNodeKind.Number; }

        internal bool IsTrue(int node) { return KindOf(node) == JsonNodeKind.True; }

        internal JsonNodeKind KindOf(int node) { return node >= 0 ? nodes[node].Kind : JsonNodeKind.Null; }

        /// <summary>Entries of a list, or keys of an object.</summary>
        internal int CountOf(int node) { return nodes[node].Count; }

        /// <summary>Byte of the array at which a container or a scalar starts.</summary>
        internal int StartOf(int node) { return nodes[node].Start; }

        /// <summary>First entry of a list, or first key of an object; only where there is one.</summary>
        internal int FirstOf(int node) { return node + 1; }

        /// <summary>The node after this one and everything in it.</summary>
        internal int After(int node) { return nodes[node].Next; }

        /// <summary>
        /// Value under a key; the last where it stands twice, as everywhere. <see cref="None"/> where it does not stand.
        /// </summary>
        internal int Find(int owner, string key)
        {
            int found = None;
            int name = owner + 1;
            for (int left = nodes[owner].Count; left > 0; left--)
            {
                int value = nodes[name].Next;
                if (IsEqual(name, key))
                {
                    found = value;
                }
                name = nodes[value].Next;
            }
            return found;
        }

        /// <summary>Entry of a list by its number, which must be there.</summary>
        internal int Entry(int list, int number)
        {
            int entry = list + 1;
            for (; number > 0; number--)
            {
                entry = nodes[entry].Next;
            }
            return entry;
        }

        /// <summary>Whether a node is a text, and this one (ASCII).</summary>
        internal bool IsEqual(int node, string ascii)
        {
            if (node < 0 || nodes[node].Kind != JsonNodeKind.Text)
            {
                return false;
            }
            JsonNode text = nodes[node];
            if (text.Count != 0)
            {
                return TextOf(node) == ascii;
            }
            if (text.Length != ascii.Length)
            {
                return false;
            }
            for (int place = 0; place < ascii.Length; place++)
            {
                if (bytes[text.Start + place] != ascii[place])
                {
                    return false;
                }
            }
            return true;
        }

        /// <summary>Whether a text starts with that character.</summary>
        internal bool StartsWith(int node, char ascii)
        {
            string text = TextOf(node);
            return text.Length > 0 && text[0] == ascii;
        }

        /// <summary>A text; the same object for the same bytes, as far as a small cache reaches.</summary>
        internal string TextOf(int node)
        {
            JsonNode text = nodes[node];
            return texts.Get(bytes, text.Start, text.Length, text.Count != 0);
        }

        /// <summary>A number in float64, correctly rounded; infinite beyond its range.</summary>
        internal double NumberOf(int node) { return numbers.Get(bytes, nodes[node].Start, nodes[node].Length); }

        /// <summary>A number as <see cref="JsonReader"/> gives it: whole where it has neither fraction nor exponent.</summary>
        internal JsonValue WholeOrFloat(int node)
        {
            JsonNode number = nodes[node];
            for (int place = number.Start; place < number.Start + number.Length; place++)
            {
                if (bytes[place] == '.' || (bytes[place] | 32) == 'e')
                {
                    return JsonValue.OfFloat(NumberOf(node));
                }
            }
            long whole;
            string text = Encoding.ASCII.GetString(bytes, number.Start, number.Length);
            bool fits = long.TryParse(text, NumberStyles.AllowLeadingSign, CultureInfo.InvariantCulture, out whole);
            return fits ? JsonValue.OfInteger(whole) : JsonValue.OfHugeInteger(NumberOf(node));
        }

        /// <summary>A value for an error text, a few dozen characters of it at most.</summary>
        internal string Shortly(int node)
        {
            if (node < 0)
            {
                return "missing";
            }
            switch (nodes[node].Kind)
            {
                case JsonNodeKind.Object: return "an object";
                case JsonNodeKind.List: return "a list";
                case JsonNodeKind.Null: return "null";
                case JsonNodeKind.Text: return "\"" + Shortened(TextOf(node)) + "\"";
                default: return Shortened(Encoding.UTF8.GetString(bytes, nodes[node].Start, nodes[node].Length));
            }
        }

        private static string Shortened(string text) { return text.Length <= 48 ? text : text.Substring(0, 48); }

        /// <summary>One value with everything in it, without recursion: hostile nesting must not use up a thread's stack.</summary>
        private void Parse()
        {
            int depth = 0;
            do
            {
                int owner = depth > 0 ? open[depth - 1] : None;
                SkipBlanks();
                if (owner != None && IsAt(nodes[owner].Kind == JsonNodeKind.Object ? (byte)'}' : (byte)']'))
                {
                    if (nodes[owner].IsExpecting)
                    {
                        throw Damaged("a comma before an end");
                    }
                    at++;
                    nodes[owner].Next = count;
                    depth--;
                    EndEntry(depth > 0 ? open[depth - 1] : None);
                    continue;
                }
                if (owner != None)
                {
                    StartEntry(owner);
                }
                byte first = Peek();
                if (first == '{' || first == '[')
                {
                    if (depth == MostDepth)
                    {
                        throw Damaged("nested more than 64 deep");
                    }
                    open[depth++] = Add(first == '{' ? JsonNodeKind.Object : JsonNodeKind.List, at, 1);
                    at++;
                    continue;
                }
                ReadScalar(first);
                EndEntry(owner);
            }
            while (depth > 0);
        }

        /// <summary>Count an entry, and in an object read its key.</summary>
        private void StartEntry(int owner)
        {
            if (nodes[owner].Count > 0 && !nodes[owner].IsExpecting)
            {
                throw Damaged("no comma between two values");
            }
            nodes[owner].Count++;
            nodes[owner].IsExpecting = false;
            if (nodes[owner].Kind == JsonNodeKind.List)
            {
                return;
            }
            ReadText();
            SkipBlanks();
            if (Peek() != ':')
            {
                throw Damaged("a key without a colon");
            }
            at++;
            SkipBlanks();
        }

        private void EndEntry(int owner)
        {
            SkipBlanks();
            if (owner != None && IsAt((byte)','))
            {
                at++;
                nodes[owner].IsExpecting = true;
            }
        }

        private void ReadScalar(byte first)
        {
            switch (first)
            {
                case (byte)'"': ReadText(); break;
                case (byte)'t': ReadWord("true", JsonNodeKind.True); break;
                case (byte)'f': ReadWord("false", JsonNodeKind.False); break;
                case (byte)'n': ReadWord("null", JsonNodeKind.Null); break;
                default: ReadNumber(); break;
            }
        }

        private void ReadWord(string word, JsonNodeKind kind)
        {
            if (end - at < word.Length)
            {
                throw Damaged("cut short");
            }
            for (int place = 0; place < word.Length; place++)
            {
                if (bytes[at + place] != word[place])
                {
                    throw Damaged("no value");
                }
            }
            Add(kind, at, word.Length);
            at += word.Length;
        }

        private void ReadText()
        {
            if (Peek() != '"')
            {
                throw Damaged("no text");
            }
            int start = ++at;
            int escapes = 0;
            while (Peek() != '"')
            {
                if (bytes[at] < 0x20)
                {
                    throw Damaged("a control character in a text");
                }
                if (bytes[at] == '\\')
                {
                    escapes++;
                    at += JsonTexts.EscapeLength(bytes, at, end);
                }
                else
                {
                    at++;
                }
            }
            nodes[Add(JsonNodeKind.Text, start, at - start)].Count = escapes;
            at++;
        }

        private void ReadNumber()
        {
            int length = JsonNumbers.LengthAt(bytes, at, end);
            if (length == 0)
            {
                throw Damaged("no value");
            }
            Add(JsonNodeKind.Number, at, length);
            at += length;
        }

        private int Add(JsonNodeKind kind, int start, int length)
        {
            if (count == most)
            {
                throw Damaged("more than " + most + " values and keys");
            }
            if (count == nodes.Length)
            {
                Array.Resize(ref nodes, 2 * count);
            }
            nodes[count] = new JsonNode { Kind = kind, Start = start, Length = length, Next = count + 1 };
            return count++;
        }

        private void SkipBlanks()
        {
            while (at < end && (bytes[at] == ' ' || bytes[at] == '\n' || bytes[at] == '\r' || bytes[at] == '\t'))
            {
                at++;
            }
        }

        private bool IsAt(byte mark) { return at < end && bytes[at] == mark; }

        private byte Peek()
        {
            if (at >= end)
            {
                throw Damaged("cut short");
            }
            return bytes[at];
        }

        private JsonException Damaged(string what) { return new JsonException(what, at); }
    }
}
