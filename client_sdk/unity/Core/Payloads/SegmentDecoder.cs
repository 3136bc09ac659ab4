using System;
using System.Collections.Generic;
using Terraport.Wire;

namespace Terraport
{
    /// <summary>
    /// Segments' payloads to meshes (segment format 2); safe on hostile bytes. One decoder serves one thread; it keeps its scratch memory,
    /// so that only the inflater allocates once that and the mesh's buffers are large enough: some kilobytes, whatever the segment.
    /// </summary>
    public sealed class SegmentDecoder
    {
        /// <summary>In which form payloads are asked for, and how their files end: the one that is decoded here.</summary>
        public const string Encoding = "segment-2";

        private const uint Magic = 0x32475354; // "TSG2" as a little-endian number.
        private const int OuterBytes = 12, HeadBytes = 40;
        private const int MaxFaces = 1 << 26, MaxAttributes = 32, FarSteps = 1 << 24;
        private const int HasColours = 1, HasUvs = 2, HasRegions = 4;
        private const ushort NoRegion = 65535;
        private static readonly string[] MediaTypes = { null, "image/jpeg", "image/png", "image/webp", "image/ktx2" };
        private readonly SegmentPlanes planes = new SegmentPlanes();

        /// <summary>Decode a segment's payload. The bytes are only read, and nothing of them is kept.</summary>
        /// <param name="payload">The whole payload.</param>
        /// <param name="attributes">The scene's, all and in their order: <see cref="SceneManifest.Attributes"/>.</param>
        /// <param name="into">Holds the result; empty where the payload is refused.</param>
        /// <exception cref="PayloadException">For anything that is not a whole payload: never another exception.</exception>
        public void Decode(ArraySegment<byte> payload, IReadOnlyList<AttributeInfo> attributes, SegmentMesh into)
        {
            if (payload.Array == null || attributes == null || into == null)
            {
                throw new ArgumentNullException(into == null ? "into" : attributes == null ? "attributes" : "payload");
            }
            into.Clear();
            try
            {
                Fill(payload.Array, payload.Offset, payload.Count, attributes, into);
            }
            catch
            {
                // Half a mesh must not be drawn.
                into.Clear();
                throw;
            }
        }

        private void Fill(byte[] payload, int start, int size, IReadOnlyList<AttributeInfo> attributes, SegmentMesh mesh)
        {
            // 1. The two parts.
            if (size < OuterBytes || LittleEndian.ReadU32(payload, start) != Magic)
            {
                throw new PayloadException("no magic TSG2 at the start", 0);
            }
            uint packedBytes = LittleEndian.ReadU32(payload, start + 4), imageBytes = LittleEndian.ReadU32(payload, start + 8);
            if (OuterBytes + (long)packedBytes + imageBytes != size || imageBytes > MeshImage.MaxBytes)
            {
                throw new PayloadException(size + " bytes, expected " + OuterBytes + " + " + packedBytes + " + " + imageBytes, 4);
            }
            planes.Inflate(payload, start + OuterBytes, (int)packedBytes, HeadBytes);
            // 2. The head.
            byte[] head = planes.Bytes;
            uint vertices = LittleEndian.ReadU32(head, 0), faces = LittleEndian.ReadU32(head, 4), mask = LittleEndian.ReadU32(head, 32);
            int flags = head[21], kind = head[22];
            // Each vertex takes eight bytes and more: the stream's length is a bound of their number.
            if (vertices == 0 || vertices > planes.Length || faces == 0 || faces > MaxFaces || flags > 7 || kind >= MediaTypes.Length)
            {
                throw new PayloadException(vertices + " vertices, " + faces + " faces, flags " + flags + ", image " + kind
                    + ", expected a face or more, no more than the stream holds, flags below 8, an image up to 4");
            }
            bool hasUvs = (flags & HasUvs) != 0;
            if (hasUvs != (kind != 0) || hasUvs != (imageBytes != 0) || (hasUvs && (flags & HasColours) != 0))
            {
                throw new PayloadException("expected an image together with texture coordinates, and no colours beside them");
            }
            if (attributes.Count < MaxAttributes && mask >> attributes.Count != 0)
            {
                throw new PayloadException("attributes " + mask.ToString("x") + ", expected some of the scene's " + attributes.Count);
            }
            mesh.VertexCount = (int)vertices;
            mesh.FaceCount = (int)faces;
            // 3. The planes, in the stream's order. Their lengths are known behind the planes of bits, before anything is reserved.
            int vertexBytes = 8 + ((flags & HasColours) != 0 ? 3 : 0) + (hasUvs ? 4 : 0) + ((flags & HasRegions) != 0 ? 2 : 0);
            for (uint bits = mask; bits != 0; bits &= bits - 1) vertexBytes += 2;
            ReadFaces(mesh, (long)vertexBytes * vertices);
            ReadPositions(mesh);
            ReadNormals(mesh);
            if ((flags & HasColours) != 0) ReadColours(mesh);
            if (hasUvs) ReadImage(mesh, payload, start + size - (int)imageBytes, (int)imageBytes);
            ReadRegions(mesh, (flags & HasRegions) != 0, LittleEndian.ReadU16(head, 24));
            for (int at = 0; at < Math.Min(attributes.Count, MaxAttributes); at++)
            {
                if ((mask >> at & 1) == 0) continue;
                MeshAttribute attribute = mesh.AddAttribute();
                attribute.Name = attributes[at].Name;
                attribute.Offset = attributes[at].Offset;
                attribute.Step = attributes[at].Step;
                attribute.Codes = Grow.To(attribute.Codes, mesh.VertexCount);
                planes.Shorts(mesh.VertexCount, attribute.Codes, 0, 1);
            }
        }

        /// <summary>Faces in strips: each but the first of a strip shares an edge with the one before, and only its third corner is named.</summary>
        private void ReadFaces(SegmentMesh mesh, long vertexBytes)
        {
            int faceBytes = (mesh.FaceCount + 7) / 8, starts = planes.Take(faceBytes), lefts = planes.Take(faceBytes);
            int corners = mesh.FaceCount + 2 * planes.CountBits(starts, mesh.FaceCount);
            int news = planes.Take((corners + 7) / 8), fresh = planes.CountBits(news, corners), oldCount = corners - fresh;
            byte[] bytes = planes.Bytes;
            if (fresh != mesh.VertexCount || (bytes[starts] & 1) == 0)
            {
                throw new PayloadException(fresh + " vertices in faces, expected " + mesh.VertexCount + ", and a start at the first face");
            }
            bool isWide = fresh > 1 << 16;
            int old = planes.Take((isWide ? 4L : 2L) * oldCount);
            if (planes.At + vertexBytes != planes.Length)
            {
                throw new PayloadException("planes of " + planes.Length + " bytes, expected " + (planes.At + vertexBytes));
            }
            uint[] indices = mesh.Indices = Grow.To(mesh.Indices, 3 * mesh.FaceCount);
            uint first = 0, second = 0, third = 0, next = 0, known = 0;
            int corner = 0;
            for (int face = 0; face < mesh.FaceCount; face++)
            {
                int named = 1;
                if ((bytes[starts + (face >> 3)] >> (face & 7) & 1) != 0)
                    named = 3;
                else if ((bytes[lefts + (face >> 3)] >> (face & 7) & 1) != 0)
                    second = third;
                else
                    first = third;
                for (; named > 0; named--, corner++)
                {
                    uint vertex = next;
                    if ((bytes[news + (corner >> 3)] >> (corner & 7) & 1) != 0)
                    {
                        next++;
                    }
                    else
                    {
                        uint zigzag = (uint)(bytes[old] | bytes[old + oldCount] << 8);
                        if (isWide) zigzag |= (uint)(bytes[old + 2 * oldCount] << 16 | bytes[old + 3 * oldCount] << 24);
                        old++;
                        known += zigzag >> 1 ^ (0 - (zigzag & 1));
                        vertex = known = isWide ? known : known & 0xFFFF;
                        if (known >= next) throw new PayloadException("a face uses vertex " + known + ", which is not there yet");
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

        private void ReadPositions(SegmentMesh mesh)
        {
            mesh.PositionCodes = Grow.To(mesh.PositionCodes, 4 * mesh.VertexCount);
            for (int axis = 0; axis < 3; axis++) planes.Shorts(mesh.VertexCount, mesh.PositionCodes, axis, 4);
            // 2 to a power by its bits: exact.
            double step = mesh.StepM = BitConverter.Int64BitsToDouble(1023L + (sbyte)planes.Bytes[20] << 52);
            mesh.Translation = new Vec3(step * OriginOf(0), step * OriginOf(1), step * OriginOf(2));
            MeshChecks.Place(mesh);
            Box box = mesh.Bounds;
            double far = Math.Max(Math.Max(Math.Max(-box.MinX, -box.MinY), Math.Max(-box.MinZ, box.MaxX)), Math.Max(box.MaxY, box.MaxZ));
            if (far >= FarSteps * step)
                throw new PayloadException("a position " + far / step + " steps from the origin, expected below 2^24");
        }

        private int OriginOf(int axis) { return (int)LittleEndian.ReadU32(planes.Bytes, 8 + 4 * axis); }

        private void ReadNormals(SegmentMesh mesh)
        {
            byte[] bytes = planes.Bytes;
            sbyte[] codes = mesh.NormalCodes = Grow.To(mesh.NormalCodes, 4 * mesh.VertexCount);
            int from = planes.Take(2L * mesh.VertexCount), x = 0, z = 0;
            for (int at = 0; at < 4 * mesh.VertexCount; at += 4, from++)
            {
                x += SegmentPlanes.Difference(bytes[from]);
                z += SegmentPlanes.Difference(bytes[from + mesh.VertexCount]);
                // The octahedron's third axis is up here.
                uint normal = MeshoptFilters.Unfolded((byte)x, (byte)z);
                codes[at] = (sbyte)normal;
                codes[at + 1] = (sbyte)(normal >> 16);
                codes[at + 2] = (sbyte)(normal >> 8);
            }
        }

        private void ReadColours(SegmentMesh mesh)
        {
            byte[] bytes = planes.Bytes;
            ushort[] colours = mesh.LinearColours = Grow.To(mesh.LinearColours, 4 * mesh.VertexCount);
            int count = mesh.VertexCount, from = planes.Take(3L * count), green = 0, red = 0, blue = 0;
            for (int at = 0; at < 4 * count; at += 4, from++)
            {
                green += SegmentPlanes.Difference(bytes[from]);
                // Less green, as blue.
                red += SegmentPlanes.Difference(bytes[from + count]);
                blue += SegmentPlanes.Difference(bytes[from + 2 * count]);
                colours[at] = LinearColour.FromSrgb((byte)(red + green));
                colours[at + 1] = LinearColour.FromSrgb((byte)green);
                colours[at + 2] = LinearColour.FromSrgb((byte)(blue + green));
                colours[at + 3] = ushort.MaxValue;
            }
            mesh.HasColours = true;
        }

        private void ReadImage(SegmentMesh mesh, byte[] payload, int start, int size)
        {
            // 1. The file, by its checksum and its header: it is the engine that decodes it, which must not meet a bomb.
            byte[] head = planes.Bytes;
            ImageHeader header = ImageHeader.Read(payload, start, size);
            int width = LittleEndian.ReadU16(head, 26), height = LittleEndian.ReadU16(head, 28);
            if (header.MediaType != MediaTypes[head[22]] || header.Width != width || header.Height != height)
            {
                throw new PayloadException("image is " + header.MediaType + " of " + header.Width + " x " + header.Height
                    + " pixels, expected " + MediaTypes[head[22]] + " of " + width + " x " + height);
            }
            header.CheckSides(ImageHeader.MaxSegmentSide);
            if (Crc32.Of(payload, start, size) != LittleEndian.ReadU32(head, 36))
                throw new PayloadException("an image with another checksum");
            mesh.Image.Set(payload, start, size, header);
            // 2. Texture coordinates, in half pixels.
            mesh.UvCodes = Grow.To(mesh.UvCodes, 2 * mesh.VertexCount);
            planes.Shorts(mesh.VertexCount, mesh.UvCodes, 0, 2);
            planes.Shorts(mesh.VertexCount, mesh.UvCodes, 1, 2);
            mesh.UvScaleU = 0.5 / width;
            mesh.UvScaleV = 0.5 / height;
            MeshChecks.UvCodes(mesh.UvCodes, mesh.VertexCount, mesh.UvScaleU, mesh.UvScaleV);
        }

        private void ReadRegions(SegmentMesh mesh, bool isEach, ushort region)
        {
            mesh.HasRegionIds = isEach || region != NoRegion;
            if (!mesh.HasRegionIds) return;
            mesh.RegionIds = Grow.To(mesh.RegionIds, mesh.VertexCount);
            if (isEach)
                planes.Shorts(mesh.VertexCount, mesh.RegionIds, 0, 1);
            else
                for (int vertex = 0; vertex < mesh.VertexCount; vertex++) mesh.RegionIds[vertex] = region;
        }
    }
}
