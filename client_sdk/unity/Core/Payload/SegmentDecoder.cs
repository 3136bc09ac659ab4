using System;
using System.IO;
using System.IO.Compression;
using Terraport.Wire;

namespace Terraport
{
    /// <summary>
    /// Decodes segments (spec/segment-format.md); safe on hostile bytes. One decoder serves one thread. It keeps its scratch memory, so that
    /// only .NET's inflater allocates: some kilobytes a segment.
    /// </summary>
    internal sealed class SegmentDecoder
    {
        private const uint Magic = 0x32475354; // "TSG2" as a little-endian number.
        private const int OuterBytes = 12, HeadBytes = 40, MaxStreamBytes = 1 << 28, MaxFaces = 1 << 26, FarSteps = 1 << 24;
        // What DEFLATE makes of a byte at most: memory is reserved for no more than the bytes can carry.
        private const int MaxExpansion = 1032;
        private const int HasColours = 1, HasUvs = 2, HasRegions = 4, IsWide = 8, MaxFlags = 15;
        private const int MaxSegmentSide = 2048, MaxBaseSide = 4096;
        private static readonly string[] MediaTypes = { null, "image/jpeg", "image/png", "image/webp", "image/ktx2" };
        private static readonly sbyte[] Octahedron = MakeOctahedron();

        // The inflated stream, and where the next plane begins.
        private byte[] stream = Array.Empty<byte>();
        private int length, at;

        /// <summary>Decode a payload. Its image stays where it is: the mesh refers to it.</summary>
        /// <param name="payload">The whole payload.</param>
        /// <param name="attributeCount">Attributes of the scene.</param>
        /// <param name="mesh">Takes the result.</param>
        /// <param name="isBase">It is the base or the overview, whose image may be larger.</param>
        /// <exception cref="PayloadException">For anything that is not a whole payload: never another exception.</exception>
        internal void Decode(ArraySegment<byte> payload, int attributeCount, SegmentMesh mesh, bool isBase = false)
        {
            byte[] bytes = payload.Array;
            int start = payload.Offset, size = payload.Count;
            // 1. The two parts.
            if (size < OuterBytes || LittleEndian.ReadU32(bytes, start) != Magic) throw new PayloadException("no magic TSG2 at the start");
            long packedBytes = LittleEndian.ReadU32(bytes, start + 4), imageBytes = LittleEndian.ReadU32(bytes, start + 8);
            if (OuterBytes + packedBytes + imageBytes != size)
                throw new PayloadException("got " + size + " bytes, expected " + OuterBytes + " + " + packedBytes + " + " + imageBytes);
            Inflate(bytes, start + OuterBytes, (int)packedBytes);
            // 2. The head.
            uint vertices = LittleEndian.ReadU32(stream, 0), faces = LittleEndian.ReadU32(stream, 4);
            uint attributes = LittleEndian.ReadU32(stream, 32);
            int flags = stream[21], kind = stream[22];
            // Each vertex takes eight bytes and more: the stream's length is a bound of their number.
            if (vertices == 0 || vertices > length || faces == 0 || faces > MaxFaces || flags > MaxFlags || kind >= MediaTypes.Length)
                throw new PayloadException("got " + vertices + " vertices, " + faces + " faces, flags " + flags + ", image " + kind);
            bool hasUvs = (flags & HasUvs) != 0;
            if (hasUvs != (kind != 0) || hasUvs != (imageBytes != 0) || (hasUvs && (flags & HasColours) != 0))
                throw new PayloadException("expected an image together with texture coordinates, and no colours besides");
            if (attributeCount < SegmentMesh.MaxAttributes && attributes >> attributeCount != 0)
                throw new PayloadException("got attributes " + attributes.ToString("x") + ", expected some of " + attributeCount);
            mesh.VertexCount = (int)vertices;
            mesh.FaceCount = (int)faces;
            // 3. The planes, in the order of the stream. Their lengths are known after the planes of bits, before memory is reserved.
            int positionBytes = (flags & IsWide) != 0 ? 4 : 2;
            long vertexBytes = 3 * positionBytes + 2 + ((flags & HasColours) != 0 ? 3 : 0) + (hasUvs ? 4 : 0);
            vertexBytes += (flags & HasRegions) != 0 ? 2 : 0;
            for (uint bits = attributes; bits != 0; bits &= bits - 1) vertexBytes += 2;
            ReadFaces(mesh, vertexBytes * vertices);
            ReadPositions(mesh, positionBytes);
            ReadNormals(mesh);
            mesh.HasColours = (flags & HasColours) != 0;
            if (mesh.HasColours) ReadColours(mesh);
            mesh.HasImage = hasUvs;
            if (hasUvs)
            {
                ReadImage(mesh, new ArraySegment<byte>(bytes, start + size - (int)imageBytes, (int)imageBytes),
                    isBase ? MaxBaseSide : MaxSegmentSide);
            }
            ReadRegions(mesh, (flags & HasRegions) != 0);
            for (int bit = 0; bit < SegmentMesh.MaxAttributes; bit++)
                mesh.Attributes[bit] = (attributes >> bit & 1) == 0 ? null : ReadShorts(mesh.Attributes[bit], vertices);
        }

        private void Inflate(byte[] packed, int start, int count)
        {
            long stated = count < 18 ? 0 : LittleEndian.ReadU32(packed, start + count - 4);
            if (stated < HeadBytes || stated > Math.Min(MaxStreamBytes, (long)count * MaxExpansion))
                throw new PayloadException("got a stream of " + count + " bytes that states a length of " + stated);
            stream = WithRoom(stream, (int)stated);
            length = 0;
            at = HeadBytes;
            try
            {
                using (var inflater = new GZipStream(new MemoryStream(packed, start, count, false), CompressionMode.Decompress))
                {
                    for (int got = -1; got != 0 && length < stated; length += got)
                        got = inflater.Read(stream, length, (int)stated - length);
                    // The inflater compares the checksum where it meets the end, to which this reads.
                    if (length == stated && inflater.ReadByte() < 0) return;
                }
            }
            catch (Exception error) when (error is IOException || error is InvalidDataException)
            {
                throw new PayloadException("the stream is damaged (" + error.Message + ")");
            }
            throw new PayloadException("the stream is cut off or too long, expected " + stated + " bytes");
        }

        /// <summary>Read the strips: each face but the first of a strip has an edge of the face before, and only its third corner is named.</summary>
        private void ReadFaces(SegmentMesh mesh, long vertexBytes)
        {
            int starts = Take((mesh.FaceCount + 7) / 8), lefts = Take((mesh.FaceCount + 7) / 8);
            int corners = mesh.FaceCount + 2 * CountBits(starts, mesh.FaceCount);
            int news = Take((corners + 7) / 8), newCount = CountBits(news, corners), oldCount = corners - newCount;
            if (newCount != mesh.VertexCount || !Bit(starts, 0))
                throw new PayloadException(
                    "got " + newCount + " vertices in faces, expected " + mesh.VertexCount + ", and a start at first");
            bool isWide = newCount > 1 << 16;
            int old = Take((isWide ? 4L : 2L) * oldCount);
            if (at + vertexBytes != length)
                throw new PayloadException("got " + length + " bytes of planes, expected " + (at + vertexBytes));
            uint[] indices = mesh.Indices = WithRoom(mesh.Indices, 3 * mesh.FaceCount);
            uint first = 0, second = 0, third = 0, fresh = 0, known = 0;
            int corner = 0;
            for (int face = 0; face < mesh.FaceCount; face++)
            {
                int named = 1;
                if (Bit(starts, face))
                    named = 3;
                else if (Bit(lefts, face))
                    second = third;
                else
                    first = third;
                for (; named > 0; named--, corner++)
                {
                    uint vertex = fresh;
                    if (Bit(news, corner))
                    {
                        fresh++;
                    }
                    else
                    {
                        uint zigzag = (uint)(stream[old] | stream[old + oldCount] << 8);
                        if (isWide) zigzag |= (uint)(stream[old + 2 * oldCount] << 16 | stream[old + 3 * oldCount] << 24);
                        old++;
                        known += zigzag >> 1 ^ (0 - (zigzag & 1));
                        vertex = known = isWide ? known : known & 0xFFFF;
                        if (known >= fresh) throw new PayloadException("a face uses vertex " + known + ", expected below " + fresh);
                    }
                    if (named == 3)
                        first = vertex;
                    else if (named == 2)
                        second = vertex;
                    else
                        third = vertex;
                }
                indices[face * 3] = first;
                indices[face * 3 + 1] = second;
                indices[face * 3 + 2] = third;
            }
        }

        private void ReadPositions(SegmentMesh mesh, int width)
        {
            int count = mesh.VertexCount;
            int[] codes = mesh.PositionCodes = WithRoom(mesh.PositionCodes, 3 * count);
            var low = new long[3];
            var high = new long[3];
            for (int axis = 0; axis < 3; axis++)
            {
                int from = Take((long)width * count);
                uint value = 0, least = uint.MaxValue, most = 0;
                for (int to = axis * count, end = to + count; to < end; to++, from++)
                {
                    uint zigzag = (uint)(stream[from] | stream[from + count] << 8);
                    if (width == 4) zigzag |= (uint)(stream[from + 2 * count] << 16 | stream[from + 3 * count] << 24);
                    value += zigzag >> 1 ^ (0 - (zigzag & 1));
                    if (width == 2) value &= 0xFFFF;
                    least = value < least ? value : least;
                    most = value > most ? value : most;
                    codes[to] = (int)value;
                }
                long origin = (int)LittleEndian.ReadU32(stream, 8 + 4 * axis);
                low[axis] = origin + least;
                high[axis] = origin + most;
                if (Math.Max(-low[axis], high[axis]) >= FarSteps)
                    throw new PayloadException("got a position at step " + high[axis] + ", expected a magnitude below 2^24");
            }
            // 2 to a power by its bits: exact.
            double step = mesh.StepM = BitConverter.Int64BitsToDouble(1023L + (sbyte)stream[20] << 52);
            mesh.Origin = new Vec3(
                (int)LittleEndian.ReadU32(stream, 8), (int)LittleEndian.ReadU32(stream, 12), (int)LittleEndian.ReadU32(stream, 16));
            mesh.Bounds = new Box((float)(step * low[0]), (float)(step * low[1]), (float)(step * low[2]), (float)(step * high[0]),
                (float)(step * high[1]), (float)(step * high[2]));
            if (!(mesh.Bounds.DiagonalM < float.MaxValue))
                throw new PayloadException("got steps of " + step + " m, expected positions in float32");
        }

        private void ReadNormals(SegmentMesh mesh)
        {
            int count = mesh.VertexCount, from = Take(2L * count), x = 0, z = 0;
            sbyte[] normals = mesh.Normals = WithRoom(mesh.Normals, 3 * count);
            for (int to = 0; to < 3 * count; to += 3, from++)
            {
                x += Difference(stream[from]);
                z += Difference(stream[from + count]);
                int entry = 3 * ((x & 255) | (z & 255) << 8);
                normals[to] = Octahedron[entry];
                normals[to + 1] = Octahedron[entry + 1];
                normals[to + 2] = Octahedron[entry + 2];
            }
        }

        private void ReadColours(SegmentMesh mesh)
        {
            int count = mesh.VertexCount, from = Take(3L * count), green = 0, red = 0, blue = 0;
            byte[] colours = mesh.Colours = WithRoom(mesh.Colours, 3 * count);
            for (int to = 0; to < 3 * count; to += 3, from++)
            {
                green += Difference(stream[from]);
                // Less green, as blue.
                red += Difference(stream[from + count]);
                blue += Difference(stream[from + 2 * count]);
                colours[to] = (byte)(red + green);
                colours[to + 1] = (byte)green;
                colours[to + 2] = (byte)(blue + green);
            }
        }

        private void ReadImage(SegmentMesh mesh, ArraySegment<byte> file, int maxSide)
        {
            // 1. The file, by its checksum and its header: the engine decodes it, and must not meet a bomb.
            ImageHeader image = ImageHeader.Read(file);
            int width = LittleEndian.ReadU16(stream, 26), height = LittleEndian.ReadU16(stream, 28);
            if (image.MediaType != MediaTypes[stream[22]] || image.Width != width || image.Height != height)
            {
                throw new PayloadException("got an image of type " + image.MediaType + ", " + image.Width + " x " + image.Height
                    + " pixels, expected " + MediaTypes[stream[22]] + ", " + width + " x " + height);
            }
            image.CheckSides((uint)maxSide);
            if (Crc32.Of(file) != LittleEndian.ReadU32(stream, 36)) throw new PayloadException("got an image with another checksum");
            mesh.Image = image;
            mesh.ImageFile = file;
            // 2. Texture coordinates, in half pixels.
            int count = mesh.VertexCount;
            mesh.UvCodes = WithRoom(mesh.UvCodes, 2 * count);
            ReadShorts(mesh.UvCodes, count, 0, 2, 2 * width);
            ReadShorts(mesh.UvCodes, count, 1, 2, 2 * height);
        }

        private void ReadRegions(SegmentMesh mesh, bool isEach)
        {
            ushort region = LittleEndian.ReadU16(stream, 24);
            mesh.HasRegions = isEach || region != SegmentMesh.NoRegion;
            if (isEach)
            {
                mesh.Regions = ReadShorts(mesh.Regions, (uint)mesh.VertexCount);
            }
            else if (mesh.HasRegions)
            {
                mesh.Regions = WithRoom(mesh.Regions, mesh.VertexCount);
                for (int vertex = 0; vertex < mesh.VertexCount; vertex++) mesh.Regions[vertex] = region;
            }
        }

        private ushort[] ReadShorts(ushort[] target, uint count)
        {
            target = WithRoom(target, (int)count);
            ReadShorts(target, (int)count, 0, 1, ushort.MaxValue);
            return target;
        }

        /// <summary>Read a plane of differences of two bytes into every <paramref name="stride"/>-th entry.</summary>
        private void ReadShorts(ushort[] target, int count, int first, int stride, int most)
        {
            int low = Take(2L * count), value = 0;
            for (int left = count, to = first; left > 0; left--, low++, to += stride)
            {
                value = value + Difference(stream[low] | stream[low + count] << 8) & 0xFFFF;
                if (value > most) throw new PayloadException("got a texture coordinate of " + value + ", expected at most " + most);
                target[to] = (ushort)value;
            }
        }

        private int Take(long count)
        {
            if (count > length - at) throw new PayloadException("got a plane of " + count + " bytes, expected at most " + (length - at));
            at += (int)count;
            return at - (int)count;
        }

        private bool Bit(int plane, int number) { return (stream[plane + (number >> 3)] >> (number & 7) & 1) != 0; }

        private int CountBits(int plane, int count)
        {
            int total = 0;
            for (int left = count; left > 0; left -= 8, plane++)
            {
                // The last byte may have bits that belong to nothing.
                for (int bits = left < 8 ? stream[plane] & ((1 << left) - 1) : stream[plane]; bits != 0; bits &= bits - 1) total++;
            }
            return total;
        }

        /// <summary>A difference from its zigzag form.</summary>
        private static int Difference(int zigzag) { return zigzag >> 1 ^ -(zigzag & 1); }

        private static T[] WithRoom<T>(T[] array, int count)
        {
            // A quarter more than is needed, so that the next larger segment often fits.
            return array != null && array.Length >= count ? array : new T[(int)Math.Min(count + count / 4L, int.MaxValue / 8)];
        }

        /// <summary>Normals by the two bytes of their octahedral form, three entries each: a root for each vertex took a third of decoding.</summary>
        private static sbyte[] MakeOctahedron()
        {
            var normals = new sbyte[3 << 16];
            for (int entry = 0; entry < 1 << 16; entry++)
            {
                int x = (sbyte)entry, z = (sbyte)(entry >> 8), y = 127 - Math.Abs(x) - Math.Abs(z);
                // The lower half of the octahedron is folded over the upper.
                int fold = Math.Min(y, 0);
                x = x >= 0 ? Math.Max(x + fold, 0) : Math.Min(x - fold, 0);
                z = z >= 0 ? Math.Max(z + fold, 0) : Math.Min(z - fold, 0);
                double length = Math.Sqrt(x * x + y * y + z * z);
                normals[3 * entry] = (sbyte)Math.Round(127 * x / length);
                normals[3 * entry + 1] = (sbyte)Math.Round(127 * y / length);
                normals[3 * entry + 2] = (sbyte)Math.Round(127 * z / length);
            }
            return normals;
        }
    }
}
