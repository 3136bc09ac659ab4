using System;
using System.Collections.Generic;
using System.IO;

namespace Terraport.Tools
{
    /// <summary>
    /// A decoded mesh in the form in which clients are compared (tests/engines/README.md, "Canonical arrays"): what the Python
    /// SDK's arrays hold, little-endian.
    /// </summary>
    internal sealed class MeshArrays
    {
        public MeshArrays(SegmentMesh mesh)
        {
            int count = mesh.VertexCount;
            VertexCount = count;
            FaceCount = mesh.FaceCount;
            Indices = new uint[mesh.FaceCount * 3];
            Array.Copy(mesh.Indices, Indices, Indices.Length);
            Positions = new float[count * 3];
            Normals = new float[count * 3];
            if (mesh.HasColours) Colours = new byte[count * 3];
            if (mesh.HasTexture) Uvs = new float[count * 2];
            for (int vertex = 0, at = 0; vertex < count; vertex++, at += 3)
            {
                mesh.PositionAt(vertex, out Positions[at], out Positions[at + 1], out Positions[at + 2]);
                mesh.NormalAt(vertex, out Normals[at], out Normals[at + 1], out Normals[at + 2]);
                if (mesh.HasColours) mesh.ColourAt(vertex, out Colours[at], out Colours[at + 1], out Colours[at + 2]);
                if (mesh.HasTexture) mesh.UvAt(vertex, out Uvs[vertex * 2], out Uvs[vertex * 2 + 1]);
            }
            // The mesh's buffers are longer than it, and used again: copies.
            if (mesh.HasRegionIds) RegionIds = Copy(mesh.RegionIds, count);
            if (mesh.HasTexture)
            {
                Image = Copy(mesh.Image.Bytes, mesh.Image.Length);
                MediaType = mesh.Image.MediaType;
                Width = mesh.Image.Width;
                Height = mesh.Image.Height;
            }
            Attributes = new List<KeyValuePair<string, float[]>>();
            foreach (MeshAttribute attribute in mesh.Attributes)
            {
                var values = new float[count];
                for (int vertex = 0; vertex < count; vertex++) values[vertex] = attribute.ValueAt(vertex);
                Attributes.Add(new KeyValuePair<string, float[]>(attribute.Name, values));
            }
        }

        public int VertexCount { get; private set; }

        public int FaceCount { get; private set; }

        /// <summary>Three per vertex, metres, scene frame.</summary>
        public readonly float[] Positions;

        public uint[] Indices { get; private set; }

        /// <summary>Three per vertex, unit.</summary>
        public readonly float[] Normals;

        /// <summary>Three per vertex, sRGB; null without.</summary>
        public readonly byte[] Colours;

        public ushort[] RegionIds { get; private set; }

        /// <summary>Two per vertex; null without a texture.</summary>
        public readonly float[] Uvs;

        public byte[] Image { get; private set; }

        public string MediaType { get; private set; }

        public int Width { get; private set; }

        public int Height { get; private set; }

        public List<KeyValuePair<string, float[]>> Attributes { get; private set; }

        /// <summary>Write the digests of all arrays, and beside them the normals' own bytes to a folder if one is given.</summary>
        public void Describe(JsonText json, string folder, uint segment)
        {
            json.Open('{');
            json.Key("vertices").Value((long)VertexCount).Key("faces").Value((long)FaceCount);
            json.Key("positions").Value(Digest(Bytes(Positions)));
            json.Key("indices").Value(Digest(Bytes(Indices)));
            json.Key("colours").Value(Digest(Colours));
            json.Key("region_ids").Value(Digest(RegionIds == null ? null : Bytes(RegionIds)));
            json.Key("uvs").Value(Digest(Uvs == null ? null : Bytes(Uvs)));
            json.Key("image").Value(Digest(Image));
            json.Key("media_type").Value(MediaType).Key("width").Value((long)Width).Key("height").Value((long)Height);
            json.Key("attributes").Open('{');
            foreach (KeyValuePair<string, float[]> attribute in Attributes)
            {
                json.Key(attribute.Key).Value(Digest(Bytes(attribute.Value)));
            }
            json.Close('}').Close('}');
            if (folder != null) File.WriteAllBytes(Path.Combine(folder, segment + ".normals"), Bytes(Normals));
        }

        public static string Digest(byte[] bytes) { return bytes == null ? null : Xxh3.Hash64(bytes).ToString("x16"); }

        private static byte[] Bytes(float[] values)
        {
            var bytes = new byte[values.Length * 4];
            Buffer.BlockCopy(values, 0, bytes, 0, bytes.Length);
            for (int at = 0; at < values.Length; at++)
            {
                // "No value" has many bit patterns; the canonical one is 0x7FC00000.
                if (!float.IsNaN(values[at])) continue;
                bytes[at * 4] = 0;
                bytes[at * 4 + 1] = 0;
                bytes[at * 4 + 2] = 0xC0;
                bytes[at * 4 + 3] = 0x7F;
            }
            return bytes;
        }

        private static byte[] Bytes(Array values)
        {
            var bytes = new byte[Buffer.ByteLength(values)];
            Buffer.BlockCopy(values, 0, bytes, 0, bytes.Length);
            return bytes;
        }

        private static T[] Copy<T>(T[] values, int count)
        {
            var copy = new T[count];
            Array.Copy(values, copy, count);
            return copy;
        }
    }
}
