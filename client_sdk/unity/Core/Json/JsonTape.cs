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
        /// <summary>No node: what <see cref="Find"/> gives for an absent key.</summary>
        internal const int None = -1;

        private const int MaxDepth = 64;
        // Nodes of the containers that are not closed yet, outermost first.
        private readonly int[] openContainers = new int[MaxDepth];
        private readonly JsonTexts texts = new JsonTexts();
        private readonly JsonNumbers numbers = new JsonNumbers();
        // Only grows: after the first few documents, reading one allocates nothing.
        private JsonNode[] nodes = new JsonNode[512];
        private int count;
        private int maxNodes;
        private byte[] bytes;
        // Next byte to be read, as an index into `bytes`; `end` is one past the document's last.
        private int cursor;
        private int end;

        /// <summary>Read a document; its first node is 0. The bytes must stay as they are while nodes are asked for.</summary>
        /// <param name="source">The array that the text lies in, as UTF-8.</param>
        /// <param name="offset">Where it starts there; offsets in errors count from 0 of the array.</param>
        /// <param name="length">Its bytes.</param>
        /// <param name="maxNodes">Values and keys at most.</param>
        /// <exception cref="JsonException">It is no JSON, nested more than 64 deep, or has too many values.</exception>
        internal void Read(byte[] source, int offset, int length, int maxNodes = int.MaxValue)
        {
            this.maxNodes = maxNodes;
            bytes = source;
            cursor = offset;
            end = offset + length;
            count = 0;
            if (!Utf8.IsValid(source, offset, length))
            {
                throw Damaged("no UTF-8");
            }
            Parse();
            SkipBlanks();
            if (cursor != end)
            {
                throw Damaged("something behind the document");
            }
        }

        /// <summary>Drop the reference to the bytes, so that a kept tape does not keep a payload alive.</summary>
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
            int match = None;
            int name = owner + 1;
            for (int remaining = nodes[owner].Count; remaining > 0; remaining--)
            {
                int value = nodes[name].Next;
                if (IsEqual(name, key))
                {
                    // No early return: of a repeated key the last one counts, as in most parsers.
                    match = value;
                }
                name = nodes[value].Next;
            }
            return match;
        }

        /// <summary>Entry of a list by its number, which must be below <see cref="CountOf"/>. Takes time in proportion to it.</summary>
        internal int Entry(int list, int number)
        {
            int entry = list + 1;
            for (; number > 0; number--)
            {
                entry = nodes[entry].Next;
            }
            return entry;
        }

        /// <summary>Whether a node is a text and equals <paramref name="ascii"/>; compared byte by byte, so nothing is allocated.</summary>
        internal bool IsEqual(int node, string ascii)
        {
            if (node < 0 || nodes[node].Kind != JsonNodeKind.Text)
            {
                return false;
            }
            JsonNode text = nodes[node];
            // With escapes the bytes are not the text: compare what they stand for.
            if (text.Count != 0)
            {
                return TextOf(node) == ascii;
            }
            if (text.Length != ascii.Length)
            {
                return false;
            }
            // Without escapes, and equal in length, ASCII compares byte by byte.
            for (int index = 0; index < ascii.Length; index++)
            {
                if (bytes[text.Start + index] != ascii[index])
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
            for (int offset = number.Start; offset < number.Start + number.Length; offset++)
            {
                if (bytes[offset] == '.' || (bytes[offset] | 32) == 'e')
                {
                    return JsonValue.OfFloat(NumberOf(node));
                }
            }
            long integer;
            string text = Encoding.ASCII.GetString(bytes, number.Start, number.Length);
            bool isInRange = long.TryParse(text, NumberStyles.AllowLeadingSign, CultureInfo.InvariantCulture, out integer);
            return isInRange ? JsonValue.OfInteger(integer) : JsonValue.OfHugeInteger(NumberOf(node));
        }

        /// <summary>A value for an error text, a few dozen characters of it at most.</summary>
        internal string Describe(int node)
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
                case JsonNodeKind.Text: return "\"" + Truncate(TextOf(node)) + "\"";
                default: return Truncate(Encoding.UTF8.GetString(bytes, nodes[node].Start, nodes[node].Length));
            }
        }

        private static string Truncate(string text) { return text.Length <= 48 ? text : text.Substring(0, 48); }

        /// <summary>One value with everything in it, without recursion: hostile nesting must not use up a thread's stack.</summary>
        private void Parse()
        {
            // Invariant: open[0..depth) are the containers around the cursor; a container's Next is set when it closes.
            int depth = 0;
            do
            {
                int owner = depth > 0 ? openContainers[depth - 1] : None;
                SkipBlanks();
                // 1. The end of the innermost container: its subtree is complete, so Next can be set.
                if (owner != None && IsAt(nodes[owner].Kind == JsonNodeKind.Object ? (byte)'}' : (byte)']'))
                {
                    if (nodes[owner].IsExpecting)
                    {
                        throw Damaged("a comma before an end");
                    }
                    cursor++;
                    nodes[owner].Next = count;
                    depth--;
                    EndEntry(depth > 0 ? openContainers[depth - 1] : None);
                    continue;
                }
                // 2. Otherwise one more entry of it begins.
                if (owner != None)
                {
                    StartEntry(owner);
                }
                // 3. The value: a container is pushed and filled in later rounds, a scalar is read at once.
                byte first = Peek();
                if (first == '{' || first == '[')
                {
                    if (depth == MaxDepth)
                    {
                        throw Damaged("nested more than 64 deep");
                    }
                    openContainers[depth++] = Add(first == '{' ? JsonNodeKind.Object : JsonNodeKind.List, cursor, 1);
                    cursor++;
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
            cursor++;
            SkipBlanks();
        }

        /// <summary>Behind a value: note the comma, if one stands there; a document's own value has no owner and takes none.</summary>
        private void EndEntry(int owner)
        {
            SkipBlanks();
            if (owner != None && IsAt((byte)','))
            {
                cursor++;
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
            if (end - cursor < word.Length)
            {
                throw Damaged("cut short");
            }
            for (int index = 0; index < word.Length; index++)
            {
                if (bytes[cursor + index] != word[index])
                {
                    throw Damaged("no value");
                }
            }
            Add(kind, cursor, word.Length);
            cursor += word.Length;
        }

        private void ReadText()
        {
            if (Peek() != '"')
            {
                throw Damaged("no text");
            }
            int start = ++cursor;
            int escapes = 0;
            while (Peek() != '"')
            {
                if (bytes[cursor] < 0x20)
                {
                    throw Damaged("a control character in a text");
                }
                if (bytes[cursor] == '\\')
                {
                    escapes++;
                    cursor += JsonTexts.EscapeLength(bytes, cursor, end);
                }
                else
                {
                    cursor++;
                }
            }
            // Escapes stay as they are in the bytes; they are resolved only where the text is asked for.
            // In two steps: adding may give the nodes another array, and `nodes[Add(...)]` would write into the old one.
            int node = Add(JsonNodeKind.Text, start, cursor - start);
            nodes[node].Count = escapes;
            cursor++;
        }

        private void ReadNumber()
        {
            int length = JsonNumbers.LengthAt(bytes, cursor, end);
            if (length == 0)
            {
                throw Damaged("no value");
            }
            Add(JsonNodeKind.Number, cursor, length);
            cursor += length;
        }

        /// <summary>Append a node; containers get their length and Next when they are closed.</summary>
        private int Add(JsonNodeKind kind, int start, int length)
        {
            if (count == maxNodes)
            {
                throw Damaged("more than " + maxNodes + " values and keys");
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
            while (cursor < end && (bytes[cursor] == ' ' || bytes[cursor] == '\n' || bytes[cursor] == '\r' || bytes[cursor] == '\t'))
            {
                cursor++;
            }
        }

        private bool IsAt(byte mark) { return cursor < end && bytes[cursor] == mark; }

        private byte Peek()
        {
            if (cursor >= end)
            {
                throw Damaged("cut short");
            }
            return bytes[cursor];
        }

        /// <summary>An error at the cursor.</summary>
        private JsonException Damaged(string reason) { return new JsonException(reason, cursor); }
    }
}
