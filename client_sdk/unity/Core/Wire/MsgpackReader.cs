using System;
using System.Collections.Generic;
using System.Text;
using Terraport.Json;

namespace Terraport.Wire
{
    /// <summary>
    /// A strict reader of one msgpack value. Nothing is reserved for a length that the bytes at hand do not have.
    /// </summary>
    internal sealed class MsgpackReader
    {
        private static readonly UTF8Encoding Utf8 = new UTF8Encoding(false, true);

        private readonly byte[] data;
        private readonly int start;
        private readonly int end;
        // Stacks shared by all nesting levels: a container pushes its items and pops them when it is complete.
        private readonly List<JsonValue> values = new List<JsonValue>();
        private readonly List<string> names = new List<string>();
        private int at;
        private int valuesLeft;

        private MsgpackReader(ArraySegment<byte> bytes, int maxValues)
        {
            valuesLeft = maxValues;
            data = bytes.Array;
            start = bytes.Offset;
            at = start;
            end = start + bytes.Count;
        }

        /// <summary>Read exactly one value; binary fields are views of the bytes.</summary>
        /// <param name="bytes">One message.</param>
        /// <param name="maxValues">Most values, keys, maps and arrays counted.</param>
        /// <exception cref="DecodeException">
        /// <c>malformed</c>: cut off, nested or counted beyond the limits, a token that no message uses, a key that is no text
        /// or stands twice, text that is no UTF-8, bytes after the end.
        /// </exception>
        internal static JsonValue Read(ArraySegment<byte> bytes, int maxValues)
        {
            var reader = new MsgpackReader(bytes, maxValues);
            JsonValue value = reader.Value(0);
            int trailing = reader.end - reader.at;
            if (trailing > 0) throw reader.Malformed("got " + trailing + " bytes after the message, expected none", reader.at);
            return value;
        }

        private JsonValue Value(int depth)
        {
            int first = at;
            // Counted per value, before anything is reserved: the bound holds however the values are nested.
            if (valuesLeft == 0) throw Malformed("got too many values", first);
            valuesLeft--;
            int token = data[Take(1)];
            // Forms whose number or length is in the token: integers, maps, lists, texts.
            if (token <= 0x7f) return JsonValue.OfInteger(token);
            if (token >= 0xe0) return JsonValue.OfInteger(token - 0x100);
            if (token <= 0x8f) return Map((uint)token & 0x0f, depth, first);
            if (token <= 0x9f) return List((uint)token & 0x0f, depth, first);
            if (token <= 0xbf) return JsonValue.OfText(Text((uint)token & 0x1f));
            switch (token)
            {
                // Forms with the width of what follows in the token. Extension types and 0xc1 have no case: no message uses them.
                case 0xc0: return default(JsonValue);
                case 0xc2: return JsonValue.OfFlag(false);
                case 0xc3: return JsonValue.OfFlag(true);
                case 0xc4: return Binary((uint)Unsigned(1));
                case 0xc5: return Binary((uint)Unsigned(2));
                case 0xc6: return Binary((uint)Unsigned(4));
                case 0xca: return JsonValue.OfFloat(new LittleEndian.FloatBits { Bits = (uint)Unsigned(4) }.Number);
                case 0xcb: return JsonValue.OfFloat(BitConverter.Int64BitsToDouble(unchecked((long)Unsigned(8))));
                case 0xcc: return JsonValue.OfInteger((long)Unsigned(1));
                case 0xcd: return JsonValue.OfInteger((long)Unsigned(2));
                case 0xce: return JsonValue.OfInteger((long)Unsigned(4));
                // uint64 may lie beyond long: kept as HugeInteger, and refused by the field's own bounds.
                case 0xcf: return Long(Unsigned(8));
                case 0xd0: return JsonValue.OfInteger(unchecked((sbyte)Unsigned(1)));
                case 0xd1: return JsonValue.OfInteger(unchecked((short)Unsigned(2)));
                case 0xd2: return JsonValue.OfInteger(unchecked((int)Unsigned(4)));
                case 0xd3: return JsonValue.OfInteger(unchecked((long)Unsigned(8)));
                case 0xd9: return JsonValue.OfText(Text((uint)Unsigned(1)));
                case 0xda: return JsonValue.OfText(Text((uint)Unsigned(2)));
                case 0xdb: return JsonValue.OfText(Text((uint)Unsigned(4)));
                case 0xdc: return List((uint)Unsigned(2), depth, first);
                case 0xdd: return List((uint)Unsigned(4), depth, first);
                case 0xde: return Map((uint)Unsigned(2), depth, first);
                case 0xdf: return Map((uint)Unsigned(4), depth, first);
                default: throw Malformed("got msgpack token 0x" + token.ToString("x2") + ", which no message uses", first);
            }
        }

        private static JsonValue Long(ulong value)
        {
            return value <= long.MaxValue ? JsonValue.OfInteger((long)value) : JsonValue.OfHugeInteger(value);
        }

        /// <summary>Move on by so many bytes, which must be there; returns where they start.</summary>
        private int Take(uint length)
        {
            int first = at;
            if (length > (uint)(end - first))
            {
                throw Malformed("got " + (end - first) + " bytes, expected " + length + " of a value", first);
            }
            at = first + (int)length;
            return first;
        }

        private ulong Unsigned(int width)
        {
            int first = Take((uint)width);
            ulong value = 0;
            for (int index = 0; index < width; index++) value = value << 8 | data[first + index];
            return value;
        }

        private JsonValue Binary(uint length)
        {
            int first = Take(length);
            return JsonValue.OfBinary(new ArraySegment<byte>(data, first, (int)length));
        }

        private string Text(uint length)
        {
            int first = Take(length);
            try
            {
                return Utf8.GetString(data, first, (int)length);
            }
            catch (ArgumentException)
            {
                throw Malformed("got text that is not UTF-8", first);
            }
        }

        private JsonValue List(uint count, int depth, int first)
        {
            ExpectContainer(count, depth, first);
            int mark = values.Count;
            for (uint number = 0; number < count; number++) values.Add(Value(depth + 1));
            return JsonValue.OfList(PopFrom(values, mark));
        }

        private JsonValue Map(uint count, int depth, int first)
        {
            ExpectContainer(count, depth, first);
            int mark = values.Count;
            int nameMark = names.Count;
            for (uint number = 0; number < count; number++)
            {
                // Noted before it is read: errors point at the key, not behind it.
                int keyStart = at;
                JsonValue key = Value(depth + 1);
                if (key.Text == null) throw Malformed("got key " + key.Show() + ", expected text", keyStart);
                names.Add(key.Text);
                values.Add(Value(depth + 1));
            }
            string repeated = JsonObject.FirstRepeated(names, nameMark);
            if (repeated != null)
            {
                throw Malformed("got key " + JsonValue.ShowText(repeated) + " twice, expected each key once", first);
            }
            return JsonValue.OfObject(new JsonObject(PopFrom(names, nameMark), PopFrom(values, mark)));
        }

        private static T[] PopFrom<T>(List<T> stack, int mark)
        {
            var popped = new T[stack.Count - mark];
            // Everything above the mark belongs to the container that ends here.
            stack.CopyTo(mark, popped, 0, popped.Length);
            stack.RemoveRange(mark, popped.Length);
            return popped;
        }

        private void ExpectContainer(uint count, int depth, int first)
        {
            // A stated count is never trusted with memory: items are pushed as they are read.
            if (count > WireLimits.MaxContainerItems)
            {
                throw Malformed("got " + count + " items, expected at most " + WireLimits.MaxContainerItems, first);
            }
            if (depth + 1 > WireLimits.MaxDepth) throw Malformed("got nesting beyond " + WireLimits.MaxDepth + " levels", first);
        }

        private DecodeException Malformed(string text, int offset) { return new DecodeException("malformed", text, offset - start); }
    }
}
