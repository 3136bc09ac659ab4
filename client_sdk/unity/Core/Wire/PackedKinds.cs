using System;
using System.Globalization;
using Terraport.Json;

namespace Terraport.Wire
{
    /// <summary>A table: one binary field of little-endian rows in msgpack, a list in JSON. Every id stands once.</summary>
    /// <typeparam name="T">A row.</typeparam>
    internal abstract class PackedKind<T> : FieldKind
    {
        private readonly int most;
        private readonly int rowBytes;

        protected PackedKind(int most, int rowBytes)
        {
            this.most = most;
            this.rowBytes = rowBytes;
        }

        internal override object Layout(JsonValue raw, bool packed)
        {
            if (!packed) return FromList(raw);
            if (raw.Kind != JsonKind.Binary || raw.Count % rowBytes != 0)
            {
                throw new RefusedException("got " + raw.Show() + ", expected binary of a multiple of " + rowBytes + " bytes");
            }
            ArraySegment<byte> bytes = raw.Bytes;
            ExpectCount(bytes.Count / rowBytes);
            var rows = new T[bytes.Count / rowBytes];
            for (int number = 0; number < rows.Length; number++)
            {
                rows[number] = RowAt(bytes.Array, bytes.Offset + number * rowBytes);
            }
            return rows;
        }

        internal override object Read(JsonValue raw, object layout)
        {
            Check(layout);
            return layout;
        }

        internal override void Check(object value)
        {
            var rows = (T[])value;
            ExpectCount(rows.Length);
            var ids = new uint[rows.Length];
            for (int number = 0; number < ids.Length; number++) ids[number] = IdOf(rows[number]);
            Array.Sort(ids);
            for (int number = 1; number < ids.Length; number++)
            {
                if (ids[number] == ids[number - 1])
                {
                    throw new RefusedException("got id " + ids[number] + " twice, expected each id once");
                }
            }
            foreach (T row in rows) CheckRow(row);
        }

        internal override JsonValue Write(object value, bool packed)
        {
            var rows = (T[])value;
            if (!packed) return JsonValue.OfList(Array.ConvertAll(rows, ListRow));
            var bytes = new byte[rows.Length * rowBytes];
            for (int number = 0; number < rows.Length; number++) WriteRow(bytes, number * rowBytes, rows[number]);
            return JsonValue.OfBinary(new ArraySegment<byte>(bytes));
        }

        internal override string Describe()
        {
            return "a table of at most " + most + " rows";
        }

        protected abstract uint IdOf(T row);

        protected abstract T RowAt(byte[] data, int at);

        protected abstract T RowOf(JsonValue raw);

        protected abstract void WriteRow(byte[] data, int at, T row);

        protected abstract JsonValue ListRow(T row);

        protected virtual void CheckRow(T row)
        {
        }

        protected static uint ExpectU32(JsonValue raw)
        {
            long value;
            if (raw.TryInteger(out value) && value >= 0 && value <= uint.MaxValue) return (uint)value;
            throw new RefusedException("got " + raw.Show() + ", expected an integer from 0 to " + uint.MaxValue);
        }

        protected static ulong ExpectHash(JsonValue raw)
        {
            string text = raw.Text;
            ulong hash = 0;
            bool isHash = text != null && text.Length == 16;
            for (int place = 0; isHash && place < 16; place++)
            {
                char digit = text[place];
                if (digit >= '0' && digit <= '9') hash = hash << 4 | (uint)(digit - '0');
                else if (digit >= 'a' && digit <= 'f') hash = hash << 4 | (uint)(digit - 'a' + 10);
                else isHash = false;
            }
            if (isHash) return hash;
            throw new RefusedException("got " + raw.Show() + ", expected 16 hexadecimal digits (0-9a-f)");
        }

        protected static JsonValue HashText(ulong hash)
        {
            return JsonValue.OfText(hash.ToString("x16", CultureInfo.InvariantCulture));
        }

        private T[] FromList(JsonValue raw)
        {
            if (raw.Kind != JsonKind.List) throw new RefusedException("got " + raw.Show() + ", expected a list");
            ExpectCount(raw.Count);
            var rows = new T[raw.Count];
            for (int number = 0; number < rows.Length; number++)
            {
                try
                {
                    rows[number] = RowOf(raw[number]);
                }
                catch (RefusedException refused)
                {
                    throw refused.Below(number.ToString(CultureInfo.InvariantCulture));
                }
            }
            return rows;
        }

        private void ExpectCount(int count)
        {
            if (count > most) throw new RefusedException("got " + count + " rows, expected at most " + most);
        }
    }

    /// <summary>Segment ids.</summary>
    internal sealed class IdsKind : PackedKind<uint>
    {
        internal IdsKind(int most)
            : base(most, 4)
        {
        }

        protected override uint IdOf(uint row)
        {
            return row;
        }

        protected override uint RowAt(byte[] data, int at)
        {
            return LittleEndian.ReadU32(data, at);
        }

        protected override uint RowOf(JsonValue raw)
        {
            return ExpectU32(raw);
        }

        protected override void WriteRow(byte[] data, int at, uint row)
        {
            LittleEndian.WriteU32(data, at, row);
        }

        protected override JsonValue ListRow(uint row)
        {
            return JsonValue.OfInteger(row);
        }
    }

    /// <summary>Held segments with their hashes.</summary>
    internal sealed class HeldKind : PackedKind<HeldRow>
    {
        internal HeldKind(int most)
            : base(most, 12)
        {
        }

        protected override uint IdOf(HeldRow row)
        {
            return row.Segment;
        }

        protected override HeldRow RowAt(byte[] data, int at)
        {
            return new HeldRow(LittleEndian.ReadU32(data, at), LittleEndian.ReadU64(data, at + 4));
        }

        protected override HeldRow RowOf(JsonValue raw)
        {
            if (raw.Kind != JsonKind.List || raw.Count != 2)
            {
                throw new RefusedException("got " + raw.Show() + ", expected [id, hash]");
            }
            return new HeldRow(ExpectU32(raw[0]), ExpectHash(raw[1]));
        }

        protected override void WriteRow(byte[] data, int at, HeldRow row)
        {
            LittleEndian.WriteU32(data, at, row.Segment);
            LittleEndian.WriteU64(data, at + 4, row.Xxh3);
        }

        protected override JsonValue ListRow(HeldRow row)
        {
            return JsonValue.OfList(new[] { JsonValue.OfInteger(row.Segment), HashText(row.Xxh3) });
        }
    }
}
