using System;
using System.Collections.Generic;
using System.Text;

namespace Terraport.Wire
{
    /// <summary>Writes one message: a msgpack map of which the number of fields is set at the end. Fields that are null are left out.</summary>
    internal sealed class MsgpackWriter
    {
        private readonly List<byte> bytes = new List<byte>(64);
        // Where the open maps begin, the outermost first, and how many fields each has.
        private readonly Stack<KeyValuePair<int, int>> open = new Stack<KeyValuePair<int, int>>();
        private int fields;

        /// <summary>Begin a message of a type.</summary>
        internal MsgpackWriter(string type)
        {
            bytes.Add(0);
            Text("type", type);
        }

        /// <summary>Return the message.</summary>
        internal byte[] ToArray()
        {
            bytes[0] = (byte)(0x80 | fields);
            return bytes.ToArray();
        }

        internal MsgpackWriter Text(string key, string value)
        {
            if (value == null) return this;
            Key(key);
            WriteText(value);
            return this;
        }

        internal MsgpackWriter Integer(string key, long? value)
        {
            if (value == null) return this;
            Key(key);
            if (value >= 0 && value < 0x80)
                bytes.Add((byte)value.Value);
            else
                BigEndian(0xD3, (ulong)value.Value, 8);
            return this;
        }

        internal MsgpackWriter Number(string key, double? value)
        {
            if (value == null) return this;
            Key(key);
            WriteNumber(value.Value);
            return this;
        }

        internal MsgpackWriter Point(string key, Vec3? value)
        {
            if (value == null) return this;
            Key(key);
            bytes.Add(0x93);
            WriteNumber(value.Value.X);
            WriteNumber(value.Value.Y);
            WriteNumber(value.Value.Z);
            return this;
        }

        /// <summary>Add content keys, 8 bytes each.</summary>
        internal MsgpackWriter Keys(string key, IReadOnlyList<ulong> values)
        {
            if (values == null) return this;
            Key(key);
            BigEndian(0xC6, (ulong)values.Count * 8, 4);
            for (int at = 0; at < values.Count; at++)
            {
                for (int shift = 0; shift < 64; shift += 8) bytes.Add((byte)(values[at] >> shift));
            }
            return this;
        }

        /// <summary>Begin a map within the message; <see cref="Close"/> ends it.</summary>
        internal MsgpackWriter Open(string key)
        {
            Key(key);
            open.Push(new KeyValuePair<int, int>(bytes.Count, fields));
            bytes.Add(0);
            fields = 0;
            return this;
        }

        internal MsgpackWriter Close()
        {
            KeyValuePair<int, int> outer = open.Pop();
            bytes[outer.Key] = (byte)(0x80 | fields);
            fields = outer.Value;
            return this;
        }

        private void Key(string key)
        {
            // A message has at most 15 fields: their number fits into the first byte of the map.
            fields++;
            WriteText(key);
        }

        private void WriteText(string value)
        {
            byte[] text = Encoding.UTF8.GetBytes(value);
            if (text.Length < 32)
                bytes.Add((byte)(0xA0 | text.Length));
            else
                BigEndian(0xDB, (ulong)text.Length, 4);
            bytes.AddRange(text);
        }

        private void WriteNumber(double value) { BigEndian(0xCB, (ulong)BitConverter.DoubleToInt64Bits(value), 8); }

        private void BigEndian(byte kind, ulong value, int size)
        {
            bytes.Add(kind);
            for (int shift = 8 * (size - 1); shift >= 0; shift -= 8) bytes.Add((byte)(value >> shift));
        }
    }
}
