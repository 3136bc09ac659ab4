using System;
using System.IO;
using System.Text;
using Terraport.Json;

namespace Terraport.Wire
{
    /// <summary>Values as msgpack: every integer in its shortest form, every float in 64 bits, as the Python side writes them.</summary>
    internal static class MsgpackWriter
    {
        private static readonly UTF8Encoding Utf8 = new UTF8Encoding(false, true);

        /// <summary>Write one value.</summary>
        internal static byte[] Write(JsonValue value)
        {
            var into = new MemoryStream();
            Value(value, into);
            return into.ToArray();
        }

        private static void Value(JsonValue value, Stream into)
        {
            // One case a kind. HugeInteger has none: no message of ours holds one.
            switch (value.Kind)
            {
                case JsonKind.Null: into.WriteByte(0xc0); break;
                case JsonKind.Flag:
                    bool flag;
                    value.TryFlag(out flag);
                    into.WriteByte(flag ? (byte)0xc3 : (byte)0xc2);
                    break;
                case JsonKind.Integer:
                    long integer;
                    value.TryInteger(out integer);
                    Integer(integer, into);
                    break;
                case JsonKind.Float:
                    double number;
                    value.TryNumber(out number);
                    Sized(0xcb, 8, unchecked((ulong)BitConverter.DoubleToInt64Bits(number)), into);
                    break;
                case JsonKind.Text: Text(value.Text, into); break;
                case JsonKind.Binary:
                    ArraySegment<byte> bytes = value.Bytes;
                    // -1: binary has no form with its length in the token.
                    Head((uint)bytes.Count, 0, -1, 0xc4, 0xc5, into);
                    into.Write(bytes.Array, bytes.Offset, bytes.Count);
                    break;
                case JsonKind.List: List(value, into); break;
                case JsonKind.Object: Map(value.Members, into); break;
                default: throw new InvalidOperationException("got " + value.Show() + ", which no message has");
            }
        }

        private static void List(JsonValue list, Stream into)
        {
            // 0: lists and maps have no form with an 8-bit count.
            Head((uint)list.Count, 0x90, 15, 0, 0xdc, into);
            for (int index = 0; index < list.Count; index++) Value(list[index], into);
        }

        private static void Map(JsonObject members, Stream into)
        {
            Head((uint)members.Count, 0x80, 15, 0, 0xde, into);
            for (int index = 0; index < members.Count; index++)
            {
                Text(members.NameAt(index), into);
                Value(members.ValueAt(index), into);
            }
        }

        private static void Integer(long value, Stream into)
        {
            if (value >= 0)
            {
                // The shortest form that holds it: the same message gives the same bytes in every language.
                if (value <= 0x7f)
                    into.WriteByte((byte)value);
                else if (value <= 0xff)
                    Sized(0xcc, 1, (ulong)value, into);
                else if (value <= 0xffff)
                    Sized(0xcd, 2, (ulong)value, into);
                else if (value <= 0xffffffffL)
                    Sized(0xce, 4, (ulong)value, into);
                else
                    Sized(0xcf, 8, (ulong)value, into);
            }
            else if (value >= -0x20)
                into.WriteByte(unchecked((byte)value));
            else if (value >= -0x80)
                Sized(0xd0, 1, unchecked((ulong)value), into);
            else if (value >= -0x8000)
                Sized(0xd1, 2, unchecked((ulong)value), into);
            else if (value >= -0x80000000L)
                Sized(0xd2, 4, unchecked((ulong)value), into);
            else
                Sized(0xd3, 8, unchecked((ulong)value), into);
        }

        private static void Text(string text, Stream into)
        {
            byte[] bytes = Utf8.GetBytes(text);
            Head((uint)bytes.Length, 0xa0, 31, 0xd9, 0xda, into);
            into.Write(bytes, 0, bytes.Length);
        }

        /// <summary>A token and a number behind it, most significant byte first.</summary>
        private static void Sized(byte token, int width, ulong value, Stream into)
        {
            into.WriteByte(token);
            for (int shift = 8 * (width - 1); shift >= 0; shift -= 8) into.WriteByte(unchecked((byte)(value >> shift)));
        }

        /// <summary>A token with its count: in the token itself, else in 8 (where there is such a form), 16 or 32 bits.</summary>
        private static void Head(uint count, byte inToken, int maxInToken, byte token8, byte token16, Stream into)
        {
            if (count <= maxInToken)
                into.WriteByte((byte)(inToken | count));
            else if (token8 != 0 && count <= 0xff)
                Sized(token8, 1, count, into);
            else if (count <= 0xffff)
                Sized(token16, 2, count, into);
            else
                // In msgpack the token for 32 bits always follows that for 16.
                Sized((byte)(token16 + 1), 4, count, into);
        }
    }
}
