using System;
using System.Collections.Generic;
using System.Text;

namespace Terraport.Wire
{
    /// <summary>
    /// Reads msgpack to values: Dictionary of string to object, object[], string, ArraySegment of bytes, long, double, bool, null.
    /// Safe on hostile bytes: nesting and items are bounded, and no memory is reserved for what is only announced.
    /// </summary>
    internal sealed class MsgpackReader
    {
        private const int MaxDepth = 16, MaxItems = 16384;
        private static readonly UTF8Encoding Utf8 = new UTF8Encoding(false, true);

        private readonly byte[] bytes;
        private readonly int end;
        private int at;

        private MsgpackReader(ArraySegment<byte> message)
        {
            bytes = message.Array;
            at = message.Offset;
            end = message.Offset + message.Count;
        }

        /// <summary>Read one map, which must take all of the bytes. Binary values are views of them.</summary>
        /// <exception cref="WireException">It is not one whole map of msgpack.</exception>
        internal static Dictionary<string, object> ReadMap(ArraySegment<byte> message)
        {
            var reader = new MsgpackReader(message);
            object value = reader.Value(0);
            if (reader.at != reader.end) throw new WireException((reader.end - reader.at) + " bytes behind the message, expected none");
            return value as Dictionary<string, object> ?? throw new WireException("got no map, expected a msgpack map");
        }

        private object Value(int depth)
        {
            if (depth > MaxDepth) throw new WireException("nested more than " + MaxDepth + " deep");
            byte kind = bytes[Take(1)];
            if (kind < 0x80) return (long)kind;
            if (kind < 0x90) return Map(kind & 15, depth);
            if (kind < 0xA0) return List(kind & 15, depth);
            if (kind < 0xC0) return Text(kind & 31);
            if (kind >= 0xE0) return (long)(sbyte)kind;
            switch (kind)
            {
                case 0xC0: return null;
                case 0xC2: return false;
                case 0xC3: return true;
                case 0xC4: return Binary(Unsigned(1));
                case 0xC5: return Binary(Unsigned(2));
                case 0xC6: return Binary(Unsigned(4));
                case 0xCA: return (double)BitConverter.ToSingle(BitConverter.GetBytes((uint)Unsigned(4)), 0);
                case 0xCB: return BitConverter.Int64BitsToDouble((long)Unsigned(8));
                case 0xCC: return (long)Unsigned(1);
                case 0xCD: return (long)Unsigned(2);
                case 0xCE: return (long)Unsigned(4);
                case 0xCF:
                    ulong large = Unsigned(8);
                    return large <= long.MaxValue ? (long)large : throw new WireException("integer " + large + ", expected below 2^63");
                case 0xD0: return (long)(sbyte)Unsigned(1);
                case 0xD1: return (long)(short)Unsigned(2);
                case 0xD2: return (long)(int)Unsigned(4);
                case 0xD3: return (long)Unsigned(8);
                case 0xD9: return Text(Unsigned(1));
                case 0xDA: return Text(Unsigned(2));
                case 0xDB: return Text(Unsigned(4));
                case 0xDC: return List(Unsigned(2), depth);
                case 0xDD: return List(Unsigned(4), depth);
                case 0xDE: return Map(Unsigned(2), depth);
                case 0xDF: return Map(Unsigned(4), depth);
                default: throw new WireException("msgpack type 0x" + kind.ToString("x2") + ", expected none of the extensions");
            }
        }

        private Dictionary<string, object> Map(ulong count, int depth)
        {
            var map = new Dictionary<string, object>();
            for (int left = ItemsOf(count, 2); left > 0; left--)
            {
                string key = Value(depth + 1) as string ?? throw new WireException("got a key that is not text");
                if (map.ContainsKey(key)) throw new WireException("got key " + key + " twice, expected each key once");
                map.Add(key, Value(depth + 1));
            }
            return map;
        }

        private Dictionary<string, object> Map(int count, int depth) { return Map((ulong)count, depth); }

        private object[] List(ulong count, int depth)
        {
            var list = new object[ItemsOf(count, 1)];
            for (int item = 0; item < list.Length; item++) list[item] = Value(depth + 1);
            return list;
        }

        private object[] List(int count, int depth) { return List((ulong)count, depth); }

        private int ItemsOf(ulong count, int valuesEach)
        {
            if (count > MaxItems || (long)count * valuesEach > end - at)
                throw new WireException(count + " items announced, expected fewer");
            return (int)count;
        }

        private string Text(ulong count)
        {
            int start = Take(count);
            try
            {
                return Utf8.GetString(bytes, start, (int)count);
            }
            catch (ArgumentException)
            {
                throw new WireException("got a text that is not UTF-8");
            }
        }

        private string Text(int count) { return Text((ulong)count); }

        private ArraySegment<byte> Binary(ulong count) { return new ArraySegment<byte>(bytes, Take(count), (int)count); }

        private ulong Unsigned(int size)
        {
            ulong value = 0;
            for (int from = Take((ulong)size), left = size; left > 0; left--) value = value << 8 | bytes[from++];
            return value;
        }

        private int Take(ulong count)
        {
            if (count > (ulong)(end - at))
                throw new WireException("message of " + count + " bytes more, expected " + (end - at) + " at most");
            at += (int)count;
            return at - (int)count;
        }
    }
}
