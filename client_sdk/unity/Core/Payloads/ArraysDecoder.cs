using System;

namespace Terraport
{
    /// <summary>
    /// Arrays payloads to meshes (scene format, section 10); safe on hostile bytes. One decoder serves one thread; it allocates
    /// nothing once the mesh's buffers are large enough.
    /// </summary>
    public sealed class ArraysDecoder
    {
        private const string Magic = "TPARRAYS";
        private const string AttributePrefix = "attribute/";
        private const int MostImageBytes = 1 << 26;
        private readonly FlatFile file = new FlatFile();

        /// <summary>Decode a payload. The bytes are only read, and nothing of them is kept.</summary>
        /// <param name="payload">The whole file.</param>
        /// <param name="into">Holds the result; empty where the payload is refused.</param>
        /// <exception cref="PayloadException">For anything that is not a whole, consistent file: never another exception.</exception>
        public void Decode(ArraySegment<byte> payload, SegmentMesh into)
        {
            if (payload.Array == null || into == null)
            {
                throw new ArgumentNullException(into == null ? "into" : "payload");
            }
            into.Clear();
            bool isWhole = false;
            try
            {
                file.Read(payload, Magic);
                Fill(into);
                isWhole = true;
            }
            finally
            {
                file.Release();
                if (!isWhole)
                {
                    into.Clear();
                }
            }
        }

        private void Fill(SegmentMesh mesh)
        {
            mesh.Encoding = PayloadEncoding.Arrays;
            int positions = Field("positions", FlatFile.ElementType.Float32, 3);
            int normals = Field("normals", FlatFile.ElementType.Float32, 3);
            int indices = file.Find("indices");
            uint faces = file.RowsOf(indices, "indices", FlatFile.ElementType.UInt32, 3);
            int colours = Optional("colours", FlatFile.ElementType.UInt8, 4);
            int regions = Optional("region_ids", FlatFile.ElementType.UInt16, 1);
            int uvs = Optional("uvs", FlatFile.ElementType.Float32, 2);
            int texture = file.Find("texture");
            if (file.Rows == 0 || faces == 0)
            {
                throw new PayloadException(file.Rows + " vertices and " + faces + " faces, expected at least one face");
            }
            if ((uvs < 0) != (texture < 0))
            {
                throw new PayloadException("a mesh with uvs or texture alone, expected both or neither");
            }
            if (texture >= 0 && colours >= 0)
            {
                throw new PayloadException("a mesh with texture and vertex colours, expected one of them (glTF multiplies)");
            }
            // Every array lies within the file, so the counts are far below 2^31.
            int vertices = (int)file.Rows;
            mesh.VertexCount = vertices;
            mesh.HasFloatPositions = true;
            mesh.Positions = Grow.To(mesh.Positions, vertices * 3);
            file.CopyTo(positions, mesh.Positions);
            MeshChecks.Finite(mesh.Positions, vertices * 3, "positions");
            mesh.Bounds = MeshChecks.BoundsOf(mesh.Positions, vertices);
            mesh.Normals = Grow.To(mesh.Normals, vertices * 3);
            file.CopyTo(normals, mesh.Normals);
            MeshChecks.Finite(mesh.Normals, vertices * 3, "normals");
            mesh.Indices = Grow.To(mesh.Indices, (int)faces * 3);
            file.CopyTo(indices, mesh.Indices);
            MeshChecks.Indices(mesh.Indices, (int)faces * 3, vertices);
            mesh.FaceCount = (int)faces;
            if (colours >= 0)
            {
                mesh.SrgbColours = Grow.To(mesh.SrgbColours, vertices * 4);
                file.CopyTo(colours, mesh.SrgbColours);
                mesh.HasColours = true;
            }
            if (regions >= 0)
            {
                mesh.RegionIds = Grow.To(mesh.RegionIds, vertices);
                file.CopyTo(regions, mesh.RegionIds);
                mesh.HasRegionIds = true;
            }
            ReadAttributes(mesh);
            if (texture >= 0)
            {
                mesh.Uvs = Grow.To(mesh.Uvs, vertices * 2);
                file.CopyTo(uvs, mesh.Uvs);
                MeshChecks.Uvs(mesh.Uvs, vertices);
                mesh.UvScaleU = 1;
                mesh.UvScaleV = 1;
                ReadImage(mesh.Image, texture);
            }
        }

        private void ReadAttributes(SegmentMesh mesh)
        {
            for (int field = 0; field < file.FieldCount; field++)
            {
                if (!file.StartsWith(field, AttributePrefix))
                {
                    continue;
                }
                string name = file.NameFrom(field, AttributePrefix.Length);
                CheckRows(field, name, FlatFile.ElementType.Float32, 1);
                MeshAttribute attribute = mesh.AddAttribute();
                attribute.Name = name;
                attribute.Offset = 0;
                attribute.Step = 0;
                attribute.Codes = null;
                attribute.Values = Grow.To(attribute.Values, mesh.VertexCount);
                file.CopyTo(field, attribute.Values);
            }
        }

        private void ReadImage(MeshImage image, int field)
        {
            file.RowsOf(field, "texture", FlatFile.ElementType.UInt8, 1);
            byte[] bytes;
            int length;
            int start = file.Locate(field, out bytes, out length);
            if (length > MostImageBytes)
            {
                throw new PayloadException("image of " + length + " bytes, expected at most " + MostImageBytes);
            }
            ImageHeader header = ImageHeader.Read(bytes, start, length);
            header.CheckSides(false);
            image.Set(bytes, start, length, header);
        }

        /// <summary>A field with a row for each vertex, which must be there.</summary>
        private int Field(string name, FlatFile.ElementType type, int components)
        {
            int field = file.Find(name);
            CheckRows(field, name, type, components);
            return field;
        }

        /// <summary>The same, or -1 where it is absent.</summary>
        private int Optional(string name, FlatFile.ElementType type, int components)
        {
            int field = file.Find(name);
            if (field >= 0)
            {
                CheckRows(field, name, type, components);
            }
            return field;
        }

        private void CheckRows(int field, string name, FlatFile.ElementType type, int components)
        {
            uint rows = file.RowsOf(field, name, type, components);
            if (rows != file.Rows)
            {
                throw new PayloadException("field " + name + " has " + rows + " rows, expected " + file.Rows + ": one a vertex");
            }
        }
    }
}
