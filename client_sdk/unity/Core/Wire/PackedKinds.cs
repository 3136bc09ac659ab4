using System;
using Terraport.Json;

namespace Terraport.Wire
{
    /// <summary>A table: one binary field of little-endian rows. Every id stands once.</summary>
    /// <typeparam name="T">A row.</typeparam>
    internal abstract class PackedKind<T> : FieldKind
    {
        private readonly int maxRows;
        private readonly int rowBytes;

        protected PackedKind(int maxRows, int rowBytes)
        {
            this.maxRows = maxRows;
            this.rowBytes = rowBytes;
        }

        internal override object Layout(JsonValue raw)
        {
            // First pass: whole rows, and no more than allowed, before memory is taken for them.
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
            // Sorted, not hashed: one array, and no choice of ids makes it slow.
            Array.Sort(ids);
            for (int number = 1; number < ids.Length; number++)
            {
                if (ids[number] == ids[number - 1])
                {
                    throw new RefusedException("got id " + ids[number] + " twice, expected each id once");
                }
            }
            // After the ids: of a table with several faults both sides name the same one.
            foreach (T row in rows) CheckRow(row);
        }

        internal override JsonValue Write(object value)
        {
            var rows = (T[])value;
            var bytes = new byte[rows.Length * rowBytes];
            for (int number = 0; number < rows.Length; number++) WriteRow(bytes, number * rowBytes, rows[number]);
            return JsonValue.OfBinary(new ArraySegment<byte>(bytes));
        }

        internal override string Describe() { return "a table of at most " + maxRows + " rows"; }

        protected abstract uint IdOf(T row);

        protected abstract T RowAt(byte[] data, int at);

        protected abstract void WriteRow(byte[] data, int at, T row);

        protected virtual void CheckRow(T row) {}

        private void ExpectCount(int count)
        {
            if (count > maxRows) throw new RefusedException("got " + count + " rows, expected at most " + maxRows);
        }
    }

    /// <summary>Segment ids.</summary>
    internal sealed class IdsKind : PackedKind<uint>
    {
        internal IdsKind(int maxRows) : base(maxRows, 4) {}

        protected override uint IdOf(uint row) { return row; }

        protected override uint RowAt(byte[] data, int at) { return LittleEndian.ReadU32(data, at); }

        protected override void WriteRow(byte[] data, int at, uint row) { LittleEndian.WriteU32(data, at, row); }
    }

    /// <summary>Held segments with their hashes.</summary>
    internal sealed class HeldKind : PackedKind<HeldRow>
    {
        internal HeldKind(int maxRows) : base(maxRows, 12) {}

        protected override uint IdOf(HeldRow row) { return row.Segment; }

        protected override HeldRow RowAt(byte[] data, int at)
        {
            return new HeldRow(LittleEndian.ReadU32(data, at), LittleEndian.ReadU64(data, at + 4));
        }

        protected override void WriteRow(byte[] data, int at, HeldRow row)
        {
            LittleEndian.WriteU32(data, at, row.Segment);
            LittleEndian.WriteU64(data, at + 4, row.Xxh3);
        }
    }
}
