using System;
using Terraport.Json;

namespace Terraport
{
    /// <summary>
    /// Accessors out of a GLB's BIN chunk: every count, offset and length is checked before anything is reserved for it.
    /// </summary>
    internal sealed class GlbAccessors
    {
        internal const int Byte = 5120;
        internal const int UnsignedShort = 5123;
        internal const int UnsignedInt = 5125;
        internal const int Float = 5126;

        private const string Meshopt = "EXT_meshopt_compression";
        /// <summary>Vertex codec 0 spends at least 4 bytes a channel per block of up to 256 rows.</summary>
        private const int VertexExpansion = 64;
        private const byte VertexHeader = 0xA0;
        private const byte IndexHeader = 0xE1;
        private const int MaxRows = 1 << 27;

        private readonly GlbDocument document;
        // Decompressed rows of the accessor that was read last; the next one overwrites them.
        private byte[] scratch;

        internal GlbAccessors(GlbDocument document) { this.document = document; }

        /// <summary>Rows of a vertex attribute, where they lie; valid until the next accessor is read.</summary>
        /// <param name="number">Node that holds the accessor's number.</param>
        /// <param name="component">Component type that it must have.</param>
        /// <param name="alternative">Another component type that it may have, or 0.</param>
        /// <param name="type">SCALAR, VEC2, VEC3 or VEC4.</param>
        /// <param name="width">Components of that type.</param>
        /// <param name="label">For error texts; also says which filter is allowed.</param>
        /// <exception cref="PayloadException">The accessor is outside the profile, or does not decompress.</exception>
        internal GlbRows Vertices(int number, int component, int alternative, string type, int width, string label)
        {
            var rows = new GlbRows();
            // 1. What the accessor states: type, count, stride.
            int view = ReadAccessor(number, component, alternative, type, label, ref rows);
            int minStride = width * SizeOf(rows.Component);
            int stride = document.Tape.Find(view, "byteStride");
            rows.Stride = stride < 0 ? minStride : document.ExpectWhole(stride, "byteStride", label, minStride);
            if (rows.Stride > 16 || rows.Stride % 4 != 0)
            {
                throw new PayloadException("byteStride of " + label + " is " + rows.Stride + ", expected 4, 8, 12 or 16");
            }
            // 2. Rows that are not compressed are used in place.
            int compression = Locate(view, label, ref rows);
            if (compression >= 0)
            {
                // 3. Compressed rows: bound the output by the input before reserving memory for it.
                int length = CheckCompression(compression, label, rows, "ATTRIBUTES");
                long bytes = (long)rows.Count * rows.Stride;
                if (length < bytes / VertexExpansion)
                {
                    throw TooShort(length, label, rows);
                }
                // 4. Decompress, then undo the filter; EXPONENTIAL is left to the caller, who wants floats elsewhere.
                rows.IsExponential = HasFilter(compression, label, rows);
                bool isOctahedral = label == "NORMAL" && document.Tape.Find(compression, "filter") >= 0 && !IsUnfiltered(compression);
                int start = Slice(compression, length, label);
                CheckHeader(start, VertexHeader, label);
                scratch = Grow.To(scratch, (int)bytes);
                if (!VertexCodec.TryDecode(document.Bytes, start, length, scratch, rows.Count, rows.Stride))
                {
                    throw new PayloadException(label + " does not decompress", document.OffsetOf(start));
                }
                if (isOctahedral)
                {
                    MeshoptFilters.Octahedral(scratch, rows.Count);
                }
                rows.Bytes = scratch;
                rows.Start = 0;
            }
            return rows;
        }

        /// <summary>Vertex numbers, three a face, into an array that grows; how many there are.</summary>
        internal int Indices(int number, ref uint[] target)
        {
            const string label = "indices";
            var rows = new GlbRows();
            int view = ReadAccessor(number, UnsignedShort, UnsignedInt, "SCALAR", label, ref rows);
            rows.Stride = SizeOf(rows.Component);
            if (rows.Count % 3 != 0)
            {
                throw new PayloadException(rows.Count + " indices, expected a multiple of 3");
            }
            int compression = Locate(view, label, ref rows);
            if (compression < 0)
            {
                target = Grow.To(target, rows.Count);
                Widen(rows, target);
                return rows.Count;
            }
            int length = CheckCompression(compression, label, rows, "TRIANGLES");
            // At least one code byte per triangle: a small file cannot make us reserve a large list.
            if (length < rows.Count / 3)
            {
                throw TooShort(length, label, rows);
            }
            if (!IsUnfiltered(compression))
            {
                throw document.Wrong(document.Tape.Find(compression, "filter"), "filter", label, "none");
            }
            int start = Slice(compression, length, label);
            CheckHeader(start, IndexHeader, label);
            target = Grow.To(target, rows.Count);
            // The codec computes in 32 bits; a 16-bit list wraps around at 65536.
            uint mask = rows.Component == UnsignedShort ? 0xFFFF : uint.MaxValue;
            if (!IndexCodec.TryDecode(document.Bytes, start, length, target, rows.Count, mask))
            {
                throw new PayloadException(label + " does not decompress", document.OffsetOf(start));
            }
            return rows.Count;
        }

        /// <summary>The bytes of an image file: where they start in the payload's array, and how many.</summary>
        internal int Image(int viewNumber, out int length)
        {
            const string label = "image";
            int view = document.Pick("bufferViews", viewNumber, "bufferView", label);
            length = document.ExpectWhole(document.Tape.Find(view, "byteLength"), "byteLength", label, 1);
            if (length > MeshImage.MaxBytes)
            {
                throw new PayloadException("image of " + length + " bytes, expected at most " + MeshImage.MaxBytes);
            }
            // An image is compressed by its own format.
            if (document.Find(document.OptionalObject(view, "extensions"), Meshopt) >= 0)
            {
                throw new PayloadException("image is compressed as geometry, expected a file as it is");
            }
            return Slice(view, length, label);
        }

        private static int SizeOf(int component) { return component == Byte ? 1 : component == UnsignedShort ? 2 : 4; }

        private static PayloadException TooShort(int length, string label, GlbRows rows)
        {
            return new PayloadException(length + " compressed bytes for " + rows.Count + " rows of " + label + ", expected more");
        }

        private static void Widen(GlbRows rows, uint[] target)
        {
            // Buffer.BlockCopy copies bytes as they lie; machine and format are both little-endian.
            if (rows.Component == UnsignedInt)
            {
                Buffer.BlockCopy(rows.Bytes, rows.Start, target, 0, rows.Count * 4);
                return;
            }
            int at = rows.Start;
            for (int row = 0; row < rows.Count; row++)
            {
                target[row] = (uint)(rows.Bytes[at] | (rows.Bytes[at + 1] << 8));
                at += 2;
            }
        }

        /// <summary>The bufferView of an accessor whose type, count and offsets are right.</summary>
        private int ReadAccessor(int number, int component, int alternative, string type, string label, ref GlbRows rows)
        {
            JsonTape tape = document.Tape;
            int accessor = document.Pick("accessors", number, "accessor", label);
            int componentNode = tape.Find(accessor, "componentType");
            double value = tape.IsNumber(componentNode) ? tape.NumberOf(componentNode) : 0;
            if ((value != component && (alternative == 0 || value != alternative)) || !tape.IsEqual(tape.Find(accessor, "type"), type))
            {
                string kind = tape.Describe(componentNode) + " " + tape.Describe(tape.Find(accessor, "type"));
                throw new PayloadException(label + " is " + kind + ", expected " + type + " of " + component);
            }
            int offset = tape.Find(accessor, "byteOffset");
            // The profile writes one bufferView per accessor: no offsets inside, no sparse rows, less to get wrong.
            if ((offset >= 0 && document.ExpectWhole(offset, "byteOffset", label, 0) != 0) || tape.Find(accessor, "sparse") >= 0)
            {
                throw new PayloadException(label + " has an offset inside its bufferView or is sparse, expected neither");
            }
            rows.Component = (int)value;
            rows.IsNormalised = tape.IsTrue(tape.Find(accessor, "normalized"));
            rows.Count = document.ExpectWhole(tape.Find(accessor, "count"), "count", label, 1);
            if (rows.Count > MaxRows)
            {
                throw new PayloadException("count of " + label + " is " + rows.Count + ", expected at most " + MaxRows);
            }
            return document.Pick("bufferViews", tape.Find(accessor, "bufferView"), "bufferView", label);
        }

        /// <summary>Find rows that lie as they are; where they are compressed, the node that says how.</summary>
        private int Locate(int view, string label, ref GlbRows rows)
        {
            int length = document.ExpectWhole(document.Tape.Find(view, "byteLength"), "byteLength", label, 1);
            // Exactly: neither rows that are cut off nor bytes that nobody looks at.
            if (length != (long)rows.Count * rows.Stride)
            {
                string rowsOf = rows.Count + " rows of " + rows.Stride;
                throw new PayloadException("bufferView of " + label + " has " + length + " bytes, expected " + rowsOf);
            }
            int compression = document.Find(document.OptionalObject(view, "extensions"), Meshopt);
            if (compression >= 0)
            {
                return document.ExpectObject(compression, Meshopt, label);
            }
            rows.Bytes = document.Bytes;
            rows.Start = Slice(view, length, label);
            return JsonTape.None;
        }

        /// <summary>Compressed bytes of rows that are packed in the way they are stated to be.</summary>
        private int CheckCompression(int compression, string label, GlbRows rows, string mode)
        {
            JsonTape tape = document.Tape;
            // The extension repeats count and stride: where they differ from the accessor's, one of them lies.
            bool isConsistent = tape.IsEqual(tape.Find(compression, "mode"), mode) && IsNumber(tape.Find(compression, "count"), rows.Count)
                && IsNumber(tape.Find(compression, "byteStride"), rows.Stride);
            if (!isConsistent)
            {
                string rowsOf = rows.Count + " rows of " + rows.Stride;
                throw new PayloadException(label + " is compressed otherwise than as " + rowsOf + " in mode " + mode);
            }
            return document.ExpectWhole(tape.Find(compression, "byteLength"), "compressed bytes", label, 1);
        }

        private bool IsNumber(int node, int value) { return document.Tape.IsNumber(node) && document.Tape.NumberOf(node) == value; }

        private bool IsUnfiltered(int compression)
        {
            int filter = document.Tape.Find(compression, "filter");
            return filter < 0 || document.Tape.IsEqual(filter, "NONE");
        }

        /// <summary>Whether the filter is EXPONENTIAL; refuses one that does not belong to the attribute.</summary>
        private bool HasFilter(int compression, string label, GlbRows rows)
        {
            JsonTape tape = document.Tape;
            int filter = tape.Find(compression, "filter");
            if (IsUnfiltered(compression) || (label == "NORMAL" && rows.Stride == 4 && tape.IsEqual(filter, "OCTAHEDRAL")))
            {
                return false;
            }
            if (label == "POSITION" && rows.Component == Float && tape.IsEqual(filter, "EXPONENTIAL"))
            {
                return true;
            }
            throw document.Wrong(filter, "filter", label, "none, or the one for it");
        }

        private void CheckHeader(int start, byte expected, string label)
        {
            if (document.Bytes[start] != expected)
            {
                string text = "codec byte " + document.Bytes[start] + " of " + label + ", expected " + expected;
                throw new PayloadException(text, document.OffsetOf(start));
            }
        }

        /// <summary>Where a slice of the BIN chunk starts in the payload's array; it lies within the chunk.</summary>
        private int Slice(int owner, int length, string label)
        {
            int buffer = document.Tape.Find(owner, "buffer");
            if (!IsNumber(buffer, 0))
            {
                throw document.Wrong(buffer, "buffer", label, "0 (the BIN chunk)");
            }
            int node = document.Tape.Find(owner, "byteOffset");
            int offset = node < 0 ? 0 : document.ExpectWhole(node, "byteOffset", label, 0);
            // In this order nothing overflows: offset is within the chunk before it is subtracted.
            if (offset > document.BinaryLength || length > document.BinaryLength - offset)
            {
                string text = label + " lies at " + offset + " with " + length + " bytes, expected within " + document.BinaryLength;
                throw new PayloadException(text, document.OffsetOf(document.BinaryStart));
            }
            return document.BinaryStart + offset;
        }
    }
}
