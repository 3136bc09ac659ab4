using System;
using System.Collections.Generic;
using System.Globalization;
using System.IO;
using System.Text;

namespace Terraport.Tests
{
    /// <summary>Writes small GLBs without compression (scene format, section 9), for meshes that a test makes up.</summary>
    internal sealed class GlbFile
    {
        private const int ChunkBytes = 8;
        private const int HeaderBytes = 12;

        private readonly MemoryStream binary = new MemoryStream();
        private readonly List<string> views = new List<string>();
        private readonly List<string> accessors = new List<string>();
        private readonly List<string> attributes = new List<string>();
        private int indicesAccessor;
        private string texture = "";
        private string textureTables = "";

        /// <summary>A mesh with these positions (metres, three a vertex) and faces; normals up.</summary>
        public static GlbFile Of(float[] positions, uint[] indices)
        {
            GlbFile file = new GlbFile();
            int vertices = positions.Length / 3;
            // Four bytes a normal: rows are multiples of four bytes.
            sbyte[] normals = new sbyte[vertices * 4];
            for (int vertex = 0; vertex < vertices; vertex++)
            {
                normals[vertex * 4 + 1] = 127;
            }
            file.AddVertices("POSITION", positions, 4, 3, 5126, "VEC3", false);
            file.AddVertices("NORMAL", normals, 1, 4, 5120, "VEC3", true);
            file.indicesAccessor = file.AddAccessor(indices, 4, indices.Length, 5125, "SCALAR", false, 0);
            return file;
        }

        /// <summary>Give it colours: four codes of linear light a vertex.</summary>
        public GlbFile WithColours(ushort[] linear)
        {
            AddVertices("COLOR_0", linear, 2, 4, 5123, "VEC4", true);
            return this;
        }

        /// <summary>Give it a PNG and texture coordinates: two codes a vertex, times the scale.</summary>
        /// <param name="scale">A power of two, at most 1.</param>
        public GlbFile WithTexture(ushort[] uvCodes, double scale, byte[] png)
        {
            AddVertices("TEXCOORD_0", uvCodes, 2, 2, 5123, "VEC2", false);
            int view = AddView(png, 1, 0);
            string factor = scale.ToString("R", CultureInfo.InvariantCulture);
            texture = ",\"baseColorTexture\":{\"index\":0,\"extensions\":{\"KHR_texture_transform\":{\"scale\":[" + factor + "," + factor
                + "]}}}";
            textureTables = ",\"textures\":[{\"source\":0}],\"images\":[{\"mimeType\":\"image/png\",\"bufferView\":" + view + "}]";
            return this;
        }

        /// <summary>Decode it into a mesh.</summary>
        public SegmentMesh Decode()
        {
            SegmentMesh mesh = new SegmentMesh();
            new GlbDecoder().Decode(new ArraySegment<byte>(Bytes()), mesh);
            return mesh;
        }

        private byte[] Bytes()
        {
            string json = "{\"asset\":{\"version\":\"2.0\"},\"scene\":0,\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0}],"
                + "\"meshes\":[{\"primitives\":[{\"attributes\":{" + string.Join(",", attributes) + "},\"indices\":" + indicesAccessor
                + ",\"material\":0}]}],\"materials\":[{\"pbrMetallicRoughness\":{\"metallicFactor\":0" + texture + "}}],"
                + "\"accessors\":[" + string.Join(",", accessors) + "],\"bufferViews\":[" + string.Join(",", views) + "],"
                + "\"buffers\":[{\"byteLength\":" + binary.Length + "}]" + textureTables + "}";
            // Chunks are multiples of four bytes; JSON is padded with blanks.
            byte[] text = Encoding.ASCII.GetBytes(json.PadRight((json.Length + 3) & ~3));
            byte[] body = binary.ToArray();
            MemoryStream whole = new MemoryStream();
            BinaryWriter writer = new BinaryWriter(whole);
            writer.Write(Encoding.ASCII.GetBytes("glTF"));
            writer.Write(2U);
            writer.Write((uint)(HeaderBytes + 2 * ChunkBytes + text.Length + body.Length));
            writer.Write((uint)text.Length);
            writer.Write(Encoding.ASCII.GetBytes("JSON"));
            writer.Write(text);
            writer.Write((uint)body.Length);
            writer.Write(Encoding.ASCII.GetBytes("BIN\0"));
            writer.Write(body);
            return whole.ToArray();
        }

        private void AddVertices(string name, Array values, int elementBytes, int width, int component, string type, bool isNormalised)
        {
            int stride = elementBytes * width;
            int number = AddAccessor(values, elementBytes, values.Length / width, component, type, isNormalised, stride);
            attributes.Add("\"" + name + "\":" + number);
        }

        private int AddAccessor(Array values, int elementBytes, int count, int component, string type, bool isNormalised, int stride)
        {
            int view = AddView(values, elementBytes, stride);
            string normalised = isNormalised ? ",\"normalized\":true" : "";
            accessors.Add("{\"bufferView\":" + view + ",\"count\":" + count + ",\"componentType\":" + component + ",\"type\":\"" + type
                + "\"" + normalised + "}");
            return accessors.Count - 1;
        }

        private int AddView(Array values, int elementBytes, int stride)
        {
            byte[] bytes = new byte[values.Length * elementBytes];
            Buffer.BlockCopy(values, 0, bytes, 0, bytes.Length);
            string byteStride = stride == 0 ? "" : ",\"byteStride\":" + stride;
            views.Add("{\"buffer\":0,\"byteOffset\":" + binary.Length + ",\"byteLength\":" + bytes.Length + byteStride + "}");
            binary.Write(bytes, 0, bytes.Length);
            // The next view starts on a multiple of four.
            binary.Write(new byte[3], 0, (int)(-binary.Length & 3));
            return views.Count - 1;
        }
    }
}
