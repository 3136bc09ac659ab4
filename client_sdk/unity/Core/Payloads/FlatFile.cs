using System;

namespace Terraport
{
    /// <summary>
    /// A file of named arrays behind a directory, with a checksum (scene format, section 5): base.cover. Reading
    /// allocates nothing once its list is large enough; every flipped bit and every truncation is noticed.
    /// </summary>
    internal sealed class FlatFile
    {
        private const int HeaderBytes = 48;
        private const int EntryBytes = 96;
        private const int NameBytes = 72;
        private const int MaxFields = 256;
        private const int Major = 1;
        private const int Alignment = 8;
        private const int ChecksumStart = 16;

        private Field[] fields = new Field[16];
        // A view, not a copy: valid between Read and Release.
        private ArraySegment<byte> file;

        /// <summary>Element types by their code.</summary>
        internal enum ElementType : byte
        {
            Int8 = 1,
            UInt8 = 2,
            Int16 = 3,
            UInt16 = 4,
            UInt32 = 5,
            Float32 = 6,
            UInt64 = 7,
        }

        /// <summary>Number of segments, base faces or vertices.</summary>
        internal uint Rows { get; private set; }

        /// <summary>Fields of known types.</summary>
        private int FieldCount { get; set; }

        /// <summary>Read the directory; the bytes must stay as they are while arrays are asked for.</summary>
        /// <remarks>magic: The eight characters that name the kind of file.</remarks>
        /// <exception cref="PayloadException">With the offset: size, magic, version, checksum, directory.</exception>
        internal void Read(ArraySegment<byte> bytes, string magic)
        {
            file = bytes;
            FieldCount = 0;
            if (bytes.Count < HeaderBytes)
            {
                throw new PayloadException(bytes.Count + " bytes, expected at least " + HeaderBytes + " for the header", 0);
            }
            for (int at = 0; at < magic.Length; at++)
            {
                if (Byte(at) != magic[at])
                {
                    throw new PayloadException("another magic, expected " + magic, 0);
                }
            }
            // Another major version may lay out anything anew; minor versions add fields, which are found by name.
            if (Short(16) != Major)
            {
                throw new PayloadException("format version " + Short(16) + ", expected " + Major, 16);
            }
            // Truncation is told as such, before the checksum calls it damage.
            if (Long(24) != (ulong)bytes.Count)
            {
                throw new PayloadException(bytes.Count + " bytes, expected " + Long(24) + " by the header", 24);
            }
            // Before the directory is looked at: from here on only a writer's mistake can be met, not a flipped bit.
            ulong actual = Xxh3.Hash64(bytes.Array, bytes.Offset + ChecksumStart, bytes.Count - ChecksumStart);
            if (actual != Long(8))
            {
                throw new PayloadException("checksum " + actual.ToString("x16") + ", expected " + Long(8).ToString("x16"), 8);
            }
            Rows = Word(40);
            ReadDirectory();
        }

        /// <summary>Drop the reference to the bytes.</summary>
        internal void Release() { file = default(ArraySegment<byte>); }

        /// <summary>Number of the field of that name (ASCII); -1 where there is none.</summary>
        internal int Find(string name)
        {
            for (int field = 0; field < FieldCount; field++)
            {
                if (IsNamed(fields[field], name))
                {
                    return field;
                }
            }
            return -1;
        }

        /// <summary>Rows of a field that must be of that type and width.</summary>
        internal uint RowsOf(int field, string name, ElementType type, int components)
        {
            if (field < 0)
            {
                throw new PayloadException("no field " + name);
            }
            if (fields[field].Type != type || fields[field].Components != components)
            {
                string expected = "expected " + type + " x " + components;
                throw new PayloadException("field " + name + " is of another type, " + expected, fields[field].At);
            }
            return fields[field].Rows;
        }

        /// <summary>Copy an array; the target has room. The machine is little-endian, as the format.</summary>
        internal void CopyTo(int field, Array target)
        {
            Buffer.BlockCopy(file.Array, file.Offset + fields[field].Start, target, 0, fields[field].Length);
        }

        private static int SizeOf(ElementType type)
        {
            switch (type)
            {
                case ElementType.Int8:
                case ElementType.UInt8: return 1;
                case ElementType.Int16:
                case ElementType.UInt16: return 2;
                case ElementType.UInt64: return 8;
                // UInt32 and Float32.
                default: return 4;
            }
        }

        private void ReadDirectory()
        {
            uint start = Word(20);
            uint count = Word(32);
            uint entryBytes = Word(36);
            if (count > MaxFields || entryBytes < EntryBytes || start < HeaderBytes)
            {
                throw new PayloadException(count + " fields of " + entryBytes + " bytes at " + start + ", expected a directory", 32);
            }
            // In 64 bits: the product of two 32-bit numbers must not wrap around.
            if (start + (ulong)count * entryBytes > (ulong)file.Count)
            {
                throw new PayloadException("a directory of " + count + " fields runs past the end at " + file.Count, 32);
            }
            fields = Grow.To(fields, (int)count);
            for (int number = 0; number < (int)count; number++)
            {
                // By the stated entry size: a later minor version may have longer entries.
                int at = (int)(start + (uint)number * entryBytes);
                byte type = Byte(at + NameBytes);
                // Types of later minor versions are skipped, not refused.
                if (type >= (byte)ElementType.Int8 && type <= (byte)ElementType.UInt64)
                {
                    fields[FieldCount] = ReadField(at);
                    FieldCount++;
                }
            }
        }

        private Field ReadField(int at)
        {
            var field = new Field { At = at, Type = (ElementType)Byte(at + NameBytes), Components = Byte(at + 73), Rows = Word(at + 76) };
            ulong offset = Long(at + 80);
            ulong length = Long(at + 88);
            ulong expected = (ulong)field.Rows * (ulong)field.Components * (ulong)SizeOf(field.Type);
            // Three statements of one size: they must agree before the array is copied by it.
            if (field.Components < 1 || length != expected)
            {
                throw new PayloadException(length + " bytes for " + field.Rows + " rows of " + field.Components + " x " + field.Type, at);
            }
            ulong size = (ulong)file.Count;
            // Written so that no sum can wrap: offset and length are 64-bit numbers of the file.
            if (offset % Alignment != 0 || offset > size || length > size - offset)
            {
                string text = "an array at " + offset + " with " + length + " bytes, expected a multiple of 8 within " + size;
                throw new PayloadException(text, at);
            }
            field.Start = (int)offset;
            field.Length = (int)length;
            field.NameLength = NameBytes;
            // Names are padded with zero bytes to a fixed length.
            while (field.NameLength > 0 && Byte(at + field.NameLength - 1) == 0)
            {
                field.NameLength--;
            }
            if (!Utf8.IsValid(file.Array, file.Offset + at, field.NameLength))
            {
                throw new PayloadException("a field's name is not UTF-8", at);
            }
            for (int earlier = 0; earlier < FieldCount; earlier++)
            {
                if (IsSameName(fields[earlier], field))
                {
                    throw new PayloadException("a field's name appears twice", at);
                }
            }
            return field;
        }

        private bool IsNamed(Field field, string name)
        {
            if (field.NameLength != name.Length)
            {
                return false;
            }
            for (int at = 0; at < name.Length; at++)
            {
                if (Byte(field.At + at) != name[at])
                {
                    return false;
                }
            }
            return true;
        }

        private bool IsSameName(Field left, Field right)
        {
            if (left.NameLength != right.NameLength)
            {
                return false;
            }
            for (int at = 0; at < left.NameLength; at++)
            {
                if (Byte(left.At + at) != Byte(right.At + at))
                {
                    return false;
                }
            }
            return true;
        }

        private byte Byte(int at) { return file.Array[file.Offset + at]; }

        private int Short(int at) { return Byte(at) | (Byte(at + 1) << 8); }

        private uint Word(int at) { return (uint)Short(at) | ((uint)Short(at + 2) << 16); }

        private ulong Long(int at) { return Word(at) | ((ulong)Word(at + 4) << 32); }

        private struct Field
        {
            /// <summary>Byte at which its directory entry, and with it the name, starts.</summary>
            internal int At;

            internal int NameLength;
            internal ElementType Type;
            internal int Components;
            internal uint Rows;
            internal int Start;
            internal int Length;
        }
    }
}
