using System;
using Terraport.Json;

namespace Terraport
{
    /// <summary>
    /// The base mesh, a GLB, to a mesh (scene format, sections 8 and 9); safe on hostile bytes. One decoder serves one thread; it keeps its
    /// scratch memory, so that decoding allocates nothing once that and the mesh's buffers are large enough.
    /// </summary>
    public sealed class GlbDecoder
    {
        private const ushort NullCode = 65535;
        private const double MaxCode = 65534;
        private readonly GlbDocument document = new GlbDocument();
        private readonly GlbAccessors accessors;
        // Positions in words of the filter EXPONENTIAL, before they become floats.
        private int[] words;

        /// <summary>A decoder with no scratch memory yet.</summary>
        public GlbDecoder() { accessors = new GlbAccessors(document); }

        /// <summary>Decode a GLB; arrays stay quantised. The bytes are only read, and nothing of them is kept.</summary>
        /// <param name="payload">The whole GLB.</param>
        /// <param name="into">Holds the result; empty where the payload is refused.</param>
        /// <exception cref="PayloadException">For anything that is not a whole GLB of the profile: never another exception.</exception>
        public void Decode(ArraySegment<byte> payload, SegmentMesh into)
        {
            if (payload.Array == null || into == null)
            {
                throw new ArgumentNullException(into == null ? "into" : "payload");
            }
            into.Clear();
            // Whatever is thrown, the mesh is left empty: half a mesh must not be drawn.
            bool isComplete = false;
            try
            {
                document.Read(payload);
                Fill(into);
                isComplete = true;
            }
            finally
            {
                // A kept decoder must not keep the payload's pooled array alive.
                document.Release();
                if (!isComplete)
                {
                    into.Clear();
                }
            }
        }

        private void Fill(SegmentMesh mesh)
        {
            JsonTape tape = document.Tape;
            // 1. The frame: one mesh of one primitive of triangles, under one node.
            CheckExtensions();
            int gltfMesh = document.Single(0, "meshes");
            int primitive = document.Single(gltfMesh, "primitives");
            int mode = tape.Find(primitive, "mode");
            if (mode >= 0 && (!tape.IsNumber(mode) || tape.NumberOf(mode) != 4))
            {
                throw document.Wrong(mode, "primitive mode", null, "4 (triangles)");
            }
            int names = document.ExpectObject(tape.Find(primitive, "attributes"), "attributes", null);
            // 2. Geometry. Positions first: they fix the vertex count that every other attribute is checked against.
            ReadTransform(mesh);
            ReadPositions(mesh, tape.Find(names, "POSITION"));
            ReadIndices(mesh, tape.Find(primitive, "indices"));
            ReadNormals(mesh, tape.Find(names, "NORMAL"));
            // 3. Appearance: vertex colours or a texture, never both.
            GlbTexture texture;
            bool hasTexture = GlbTexture.TryFind(document, primitive, out texture);
            int colours = tape.Find(names, "COLOR_0");
            if (hasTexture && colours >= 0)
            {
                throw new PayloadException("texture and COLOR_0 in one mesh, expected one of them (glTF multiplies)");
            }
            if (colours >= 0)
            {
                ReadColours(mesh, colours);
            }
            // 4. Labels and survey attributes.
            int regions = tape.Find(names, "_FEATURE_ID_0");
            if (regions >= 0)
            {
                mesh.RegionIds = ReadCodes(mesh, regions, "_FEATURE_ID_0", mesh.RegionIds);
                mesh.HasRegionIds = true;
            }
            ReadAttributes(mesh, names, gltfMesh);
            // 5. Texture last: copying the image is the dearest step, and a damaged mesh should not pay for it.
            if (hasTexture)
            {
                ReadUvs(mesh, tape.Find(names, "TEXCOORD_0"), texture);
                ReadImage(mesh.Image, texture);
            }
        }

        private void CheckExtensions()
        {
            JsonTape tape = document.Tape;
            int list = tape.Find(0, "extensionsRequired");
            if (list < 0)
            {
                return;
            }
            document.ExpectList(list, "extensionsRequired");
            int entry = list + 1;
            for (int remaining = tape.CountOf(list); remaining > 0; remaining--)
            {
                // Required means that a reader without it must refuse; extensions that are only used may be anything.
                bool isSupported = tape.IsEqual(entry, "KHR_mesh_quantization") || tape.IsEqual(entry, "EXT_meshopt_compression")
                    || tape.IsEqual(entry, "EXT_mesh_features") || tape.IsEqual(entry, GlbTexture.UvTransform)
                    || tape.IsEqual(entry, GlbTexture.WebpExtension) || tape.IsEqual(entry, GlbTexture.BasisExtension);
                if (!isSupported)
                {
                    throw document.Wrong(entry, "required extension", null, "one that we know");
                }
                entry = tape.After(entry);
            }
        }

        private void ReadTransform(SegmentMesh mesh)
        {
            int node = document.Single(0, "nodes");
            if (document.Tape.Find(node, "matrix") >= 0 || document.Tape.Find(node, "rotation") >= 0)
            {
                throw new PayloadException("node has a matrix or rotation, expected translation and scale alone");
            }
            mesh.Translation = document.Triple(node, "translation", 0);
            // The three axes share one step, a power of two: codes stay exact in float32, and borders stay equal.
            Vec3 scale = document.Triple(node, "scale", 1);
            // Written as a negation, so that a NaN is refused too.
            if (!(scale.X > 0) || scale.Y != scale.X || scale.Z != scale.X)
            {
                throw new PayloadException("node scale " + scale + ", expected one positive number three times");
            }
            mesh.StepM = scale.X;
        }

        private void ReadPositions(SegmentMesh mesh, int number)
        {
            GlbRows rows = accessors.Vertices(number, GlbAccessors.UnsignedShort, GlbAccessors.Float, "VEC3", 3, "POSITION");
            mesh.VertexCount = rows.Count;
            mesh.HasFloatPositions = rows.Component == GlbAccessors.Float;
            if (!mesh.HasFloatPositions)
            {
                // Four entries a vertex: glTF pads rows to multiples of four bytes.
                mesh.PositionCodes = Grow.To(mesh.PositionCodes, rows.Count * 4);
                Copy(rows, 8, mesh.PositionCodes);
                MeshChecks.Place(mesh);
                return;
            }
            // Floats are metres of the scene frame as they are; a transform over them would round.
            if (mesh.StepM != 1 || !mesh.Translation.Equals(new Vec3(0, 0, 0)))
            {
                throw new PayloadException("float positions with a node transform, expected none");
            }
            mesh.Positions = Grow.To(mesh.Positions, rows.Count * 3);
            if (rows.IsExponential)
            {
                words = Grow.To(words, rows.Count * 3);
                Copy(rows, 12, words);
                MeshoptFilters.Exponential(words, mesh.Positions, rows.Count * 3);
            }
            else
            {
                Copy(rows, 12, mesh.Positions);
            }
            MeshChecks.Finite(mesh.Positions, rows.Count * 3, "positions");
            mesh.Bounds = MeshChecks.BoundsOf(mesh.Positions, rows.Count);
        }

        private void ReadIndices(SegmentMesh mesh, int number)
        {
            uint[] indices = mesh.Indices;
            int count = accessors.Indices(number, ref indices);
            // A property cannot be passed by reference: the grown array goes back by hand.
            mesh.Indices = indices;
            MeshChecks.Indices(indices, count, mesh.VertexCount);
            mesh.FaceCount = count / 3;
        }

        private void ReadNormals(SegmentMesh mesh, int number)
        {
            GlbRows rows = accessors.Vertices(number, GlbAccessors.Byte, 0, "VEC3", 3, "NORMAL");
            ExpectRows(rows, mesh, "NORMAL");
            mesh.NormalCodes = Grow.To(mesh.NormalCodes, rows.Count * 4);
            Copy(rows, 4, mesh.NormalCodes);
            MeshChecks.NormalCodes(mesh.NormalCodes, rows.Count);
        }

        private void ReadColours(SegmentMesh mesh, int number)
        {
            GlbRows rows = accessors.Vertices(number, GlbAccessors.UnsignedShort, 0, "VEC4", 4, "COLOR_0");
            ExpectRows(rows, mesh, "COLOR_0");
            mesh.LinearColours = Grow.To(mesh.LinearColours, rows.Count * 4);
            Copy(rows, 8, mesh.LinearColours);
            mesh.HasColours = true;
        }

        private ushort[] ReadCodes(SegmentMesh mesh, int number, string name, ushort[] target)
        {
            GlbRows rows = accessors.Vertices(number, GlbAccessors.UnsignedShort, 0, "SCALAR", 1, name);
            ExpectRows(rows, mesh, name);
            target = Grow.To(target, rows.Count);
            int at = rows.Start;
            for (int row = 0; row < rows.Count; row++)
            {
                target[row] = (ushort)(rows.Bytes[at] | (rows.Bytes[at + 1] << 8));
                at += rows.Stride;
            }
            return target;
        }

        private void ReadAttributes(SegmentMesh mesh, int names, int gltfMesh)
        {
            JsonTape tape = document.Tape;
            int terraport = document.OptionalObject(document.OptionalObject(gltfMesh, "extras"), "terraport");
            int list = document.Find(terraport, "attributes");
            if (list < 0)
            {
                return;
            }
            document.ExpectList(list, "extras.terraport.attributes");
            int row = list + 1;
            for (int remaining = tape.CountOf(list); remaining > 0; remaining--)
            {
                document.ExpectObject(row, "attribute", null);
                int name = tape.Find(row, "name");
                int gltfName = tape.Find(row, "gltf_name");
                if (!tape.IsText(name) || !tape.IsText(gltfName) || !tape.StartsWith(gltfName, '_'))
                {
                    throw document.Wrong(gltfName, "attribute name", tape.Describe(name), "text and _TEXT");
                }
                int nullCode = tape.Find(row, "null");
                if (nullCode >= 0 && (!tape.IsNumber(nullCode) || tape.NumberOf(nullCode) != NullCode))
                {
                    throw document.Wrong(nullCode, "null code", tape.Describe(name), "65535");
                }
                MeshAttribute attribute = mesh.AddAttribute();
                attribute.Name = tape.TextOf(name);
                attribute.Offset = document.ExpectFinite(tape.Find(row, "offset"), "offset", attribute.Name);
                attribute.Step = document.ExpectFinite(tape.Find(row, "step"), "step", attribute.Name);
                // Both ends of the range are checked once, so that no value needs a check.
                double lastValue = attribute.Offset + attribute.Step * MaxCode;
                if (!(attribute.Step > 0) || Math.Abs(attribute.Offset) > float.MaxValue || !(Math.Abs(lastValue) <= float.MaxValue))
                {
                    throw new PayloadException("scale of " + attribute.Name + ": expected a step above 0 and values within float32");
                }
                string gltfText = tape.TextOf(gltfName);
                attribute.Codes = ReadCodes(mesh, tape.Find(names, gltfText), gltfText, attribute.Codes);
                row = tape.After(row);
            }
        }

        private void ReadUvs(SegmentMesh mesh, int number, GlbTexture texture)
        {
            GlbRows rows = accessors.Vertices(number, GlbAccessors.UnsignedShort, 0, "VEC2", 2, "TEXCOORD_0");
            ExpectRows(rows, mesh, "TEXCOORD_0");
            // Either fractions of 65535, or codes on a grid with a scale; both at once would be neither.
            if (texture.HasScale == rows.IsNormalised)
            {
                throw new PayloadException("TEXCOORD_0 must be normalised without a transform, and not with one");
            }
            mesh.UvCodes = Grow.To(mesh.UvCodes, rows.Count * 2);
            Copy(rows, 4, mesh.UvCodes);
            mesh.UvScaleU = texture.HasScale ? texture.ScaleU : 1.0 / 65535;
            mesh.UvScaleV = texture.HasScale ? texture.ScaleV : 1.0 / 65535;
            if (texture.HasScale)
            {
                // Codes over all 16 bits cannot leave the image.
                MeshChecks.UvCodes(mesh.UvCodes, rows.Count, mesh.UvScaleU, mesh.UvScaleV);
            }
        }

        private void ReadImage(MeshImage image, GlbTexture texture)
        {
            int length;
            int start = accessors.Image(texture.View, out length);
            ImageHeader header = ImageHeader.Read(document.Bytes, start, length);
            if (header.MediaType != texture.MediaType)
            {
                throw new PayloadException("image is " + header.MediaType + ", expected " + texture.MediaType + " by mimeType");
            }
            // By the header alone: the file itself is decoded by the engine, which must not meet a bomb.
            header.CheckSides(ImageHeader.MaxBaseSide);
            image.Set(document.Bytes, start, length, header);
        }

        private static void ExpectRows(GlbRows rows, SegmentMesh mesh, string label)
        {
            if (rows.Count != mesh.VertexCount)
            {
                throw new PayloadException(label + " has " + rows.Count + " rows, expected " + mesh.VertexCount + ": one a vertex");
            }
        }

        /// <summary>The first bytes of every row, one row after the other; the machine is little-endian, as the format.</summary>
        private static void Copy(GlbRows rows, int rowBytes, Array target)
        {
            if (rows.Stride == rowBytes)
            {
                Buffer.BlockCopy(rows.Bytes, rows.Start, target, 0, rows.Count * rowBytes);
                return;
            }
            // Rows may be padded by more than the target's: the rest is left behind.
            int copiedBytes = Math.Min(rows.Stride, rowBytes);
            for (int row = 0; row < rows.Count; row++)
            {
                Buffer.BlockCopy(rows.Bytes, rows.Start + row * rows.Stride, target, row * rowBytes, copiedBytes);
            }
        }
    }
}
