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
        /// <summary>What 4096 x 4096 pixels take uncompressed.</summary>
        private const int MostImageBytes = 1 << 26;
        private const int MostRows = 1 << 27;

        private readonly GlbDocument document;
        private byte[] rows;

        internal GlbAccessors(GlbDocument document) { this.document = document; }

        /// <summary>Rows of a vertex attribute.</summary>
        /// <remarks>number: Node that holds the accessor's number.
        /// component: Component type that it must have; <paramref name="other"/> is another one, or 0.
        /// type: SCALAR, VEC2, VEC3 or VEC4, of <paramref name="width"/> components.
        /// label: For error texts; also says which filter is allowed.</remarks>
        internal GlbRows Vertices(int number, int component, int other, string type, int width, string label)
        {
            var found = new GlbRows();
            int view = Find(number, component, other, type, label, ref found);
            int least = width * SizeOf(found.Component);
            int stride = document.Tape.Find(view, "byteStride");
            found.Stride = stride < 0 ? least : document.ExpectWhole(stride, "byteStride", label, least);
            if (found.Stride > 16 || found.Stride % 4 != 0)
            {
                throw new PayloadException("byteStride of " + label + " is " + found.Stride + ", expected 4, 8, 12 or 16");
            }
            int packed = Locate(view, label, ref found);
            if (packed >= 0)
            {
                int length = CheckPacked(packed, label, found, "ATTRIBUTES");
                long bytes = (long)found.Count * found.Stride;
                if (length < bytes / VertexExpansion)
                {
                    throw Short(length, label, found);
                }
                found.IsExponential = HasFilter(packed, label, found);
                bool isOctahedral = label == "NORMAL" && document.Tape.Find(packed, "filter") >= 0 && !IsUnfiltered(packed);
                int start = Slice(packed, length, label);
                CheckHeader(start, VertexHeader, label);
                rows = Grow.To(rows, (int)bytes);
                if (!VertexCodec.TryDecode(document.Bytes, start, length, rows, found.Count, found.Stride))
                {
                    throw new PayloadException(label + " does not decompress", document.OffsetOf(start));
                }
                if (isOctahedral)
                {
                    MeshoptFilters.Octahedral(rows, found.Count);
                }
                found.Bytes = rows;
                found.Start = 0;
            }
            return found;
        }

        /// <summary>Vertex numbers, three a face, into an array that grows; how many there are.</summary>
        internal int Indices(int number, ref uint[] target)
        {
            const string label = "indices";
            var found = new GlbRows();
            int view = Find(number, UnsignedShort, UnsignedInt, "SCALAR", label, ref found);
            found.Stride = SizeOf(found.Component);
            if (found.Count % 3 != 0)
            {
                throw new PayloadException(found.Count + " indices, expected a multiple of 3");
            }
            int packed = Locate(view, label, ref found);
            if (packed < 0)
            {
                target = Grow.To(target, found.Count);
                Widen(found, target);
                return found.Count;
            }
            int length = CheckPacked(packed, label, found, "TRIANGLES");
            if (length < found.Count / 3)
            {
                throw Short(length, label, found);
            }
            if (!IsUnfiltered(packed))
            {
                throw document.Wrong(document.Tape.Find(packed, "filter"), "filter", label, "none");
            }
            int start = Slice(packed, length, label);
            CheckHeader(start, IndexHeader, label);
            target = Grow.To(target, found.Count);
            uint mask = found.Component == UnsignedShort ? 0xFFFF : uint.MaxValue;
            if (!IndexCodec.TryDecode(document.Bytes, start, length, target, found.Count, mask))
            {
                throw new PayloadException(label + " does not decompress", document.OffsetOf(start));
            }
            return found.Count;
        }

        /// <summary>The bytes of an image file: where they start in the payload's array, and how many.</summary>
        internal int Image(int viewNumber, out int length)
        {
            const string label = "image";
            int view = document.Pick("bufferViews", viewNumber, "bufferView", label);
            length = document.ExpectWhole(document.Tape.Find(view, "byteLength"), "byteLength", label, 1);
            if (length > MostImageBytes)
            {
                throw new PayloadException("image of " + length + " bytes, expected at most " + MostImageBytes);
            }
            if (document.Find(document.OptionalObject(view, "extensions"), Meshopt) >= 0)
            {
                throw new PayloadException("image is compressed as geometry, expected a file as it is");
            }
            return Slice(view, length, label);
        }

        private static int SizeOf(int component) { return component == Byte ? 1 : component == UnsignedShort ? 2 : 4; }

        private static PayloadException Short(int length, string label, GlbRows found)
        {
            return new PayloadException(length + " compressed bytes for " + found.Count + " rows of " + label + ", expected more");
        }

        private static void Widen(GlbRows found, uint[] target)
        {
            if (found.Component == UnsignedInt)
            {
                Buffer.BlockCopy(found.Bytes, found.Start, target, 0, found.Count * 4);
                return;
            }
            int at = found.Start;
            for (int row = 0; row < found.Count; row++)
            {
                target[row] = (uint)(found.Bytes[at] | (found.Bytes[at + 1] << 8));
                at += 2;
            }
        }

        /// <summary>The bufferView of an accessor whose type, count and place are right.</summary>
        private int Find(int number, int component, int other, string type, string label, ref GlbRows found)
        {
            JsonTape tape = document.Tape;
            int accessor = document.Pick("accessors", number, "accessor", label);
            int stated = tape.Find(accessor, "componentType");
            double value = tape.IsNumber(stated) ? tape.NumberOf(stated) : 0;
            if ((value != component && (other == 0 || value != other)) || !tape.IsEqual(tape.Find(accessor, "type"), type))
            {
                string kind = tape.Shortly(stated) + " " + tape.Shortly(tape.Find(accessor, "type"));
                throw new PayloadException(label + " is " + kind + ", expected " + type + " of " + component);
            }
            int offset = tape.Find(accessor, "byteOffset");
            if ((offset >= 0 && document.ExpectWhole(offset, "byteOffset", label, 0) != 0) || tape.Find(accessor, "sparse") >= 0)
            {
                throw new PayloadException(label + " has an offset inside its bufferView or is sparse, expected neither");
            }
            found.Component = (int)value;
            found.IsNormalised = tape.IsTrue(tape.Find(accessor, "normalized"));
            found.Count = document.ExpectWhole(tape.Find(accessor, "count"), "count", label, 1);
            if (found.Count > MostRows)
            {
                throw new PayloadException("count of " + label + " is " + found.Count + ", expected at most " + MostRows);
            }
            return document.Pick("bufferViews", tape.Find(accessor, "bufferView"), "bufferView", label);
        }

        /// <summary>Find rows that lie as they are; where they are compressed, the node that says how.</summary>
        private int Locate(int view, string label, ref GlbRows found)
        {
            int length = document.ExpectWhole(document.Tape.Find(view, "byteLength"), "byteLength", label, 1);
            if (length != (long)found.Count * found.Stride)
            {
                string rowsOf = found.Count + " rows of " + found.Stride;
                throw new PayloadException("bufferView of " + label + " has " + length + " bytes, expected " + rowsOf);
            }
            int packed = document.Find(document.OptionalObject(view, "extensions"), Meshopt);
            if (packed >= 0)
            {
                return document.ExpectObject(packed, Meshopt, label);
            }
            found.Bytes = document.Bytes;
            found.Start = Slice(view, length, label);
            return JsonTape.None;
        }

        /// <summary>Compressed bytes of rows that are packed in the way they are stated to be.</summary>
        private int CheckPacked(int packed, string label, GlbRows found, string mode)
        {
            JsonTape tape = document.Tape;
            bool isSame = tape.IsEqual(tape.Find(packed, "mode"), mode) && IsNumber(tape.Find(packed, "count"), found.Count)
                && IsNumber(tape.Find(packed, "byteStride"), found.Stride);
            if (!isSame)
            {
                string rowsOf = found.Count + " rows of " + found.Stride;
                throw new PayloadException(label + " is compressed otherwise than as " + rowsOf + " in mode " + mode);
            }
            return document.ExpectWhole(tape.Find(packed, "byteLength"), "compressed bytes", label, 1);
        }

        private bool IsNumber(int node, int value) { return document.Tape.IsNumber(node) && document.Tape.NumberOf(node) == value; }

        private bool IsUnfiltered(int packed)
        {
            int filter = document.Tape.Find(packed, "filter");
            return filter < 0 || document.Tape.IsEqual(filter, "NONE");
        }

        /// <summary>Whether the filter is EXPONENTIAL; refuses one that does not belong to the attribute.</summary>
        private bool HasFilter(int packed, string label, GlbRows found)
        {
            JsonTape tape = document.Tape;
            int filter = tape.Find(packed, "filter");
            if (IsUnfiltered(packed) || (label == "NORMAL" && found.Stride == 4 && tape.IsEqual(filter, "OCTAHEDRAL")))
            {
                return false;
            }
            if (label == "POSITION" && found.Component == Float && tape.IsEqual(filter, "EXPONENTIAL"))
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

        /// <summary>Where a part of the BIN chunk starts in the payload's array; it lies within the chunk.</summary>
        private int Slice(int where, int length, string label)
        {
            int buffer = document.Tape.Find(where, "buffer");
            if (!IsNumber(buffer, 0))
            {
                throw document.Wrong(buffer, "buffer", label, "0 (the BIN chunk)");
            }
            int node = document.Tape.Find(where, "byteOffset");
            int offset = node < 0 ? 0 : document.ExpectWhole(node, "byteOffset", label, 0);
            if (offset > document.BinaryLength || length > document.BinaryLength - offset)
            {
                string text = label + " lies at " + offset + " with " + length + " bytes, expected within " + document.BinaryLength;
                throw new PayloadException(text, document.OffsetOf(document.BinaryStart));
            }
            return document.BinaryStart + offset;
        }
    }
}
