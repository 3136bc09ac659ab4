using System;
using System.Collections.Generic;
using System.IO;
using System.Linq;
using System.Security.Cryptography;

namespace Terraport.Tools
{
    /// <summary>The arrays of a mesh as every client is compared by (tests/engines/README.md, "Canonical arrays").</summary>
    internal sealed class MeshArrays
    {
        public readonly float[] Positions, Normals, Uvs;
        public readonly uint[] Indices;
        public readonly byte[] Colours;
        public readonly ushort[] Regions;
        public readonly Dictionary<string, float[]> Attributes = new Dictionary<string, float[]>();

        /// <summary>SHA-256 of the bytes of each array; null for one that the mesh lacks.</summary>
        public readonly Dictionary<string, object> Digests;

        public MeshArrays(SegmentMesh mesh, IReadOnlyList<AttributeInfo> scales)
        {
            int count = mesh.VertexCount;
            Positions = new float[3 * count];
            Normals = new float[3 * count];
            for (int vertex = 0; vertex < count; vertex++)
            {
                mesh.PositionAt(vertex, out Positions[3 * vertex], out Positions[3 * vertex + 1], out Positions[3 * vertex + 2]);
                double x = mesh.Normals[3 * vertex], y = mesh.Normals[3 * vertex + 1], z = mesh.Normals[3 * vertex + 2];
                double length = Math.Sqrt(x * x + y * y + z * z);
                Normals[3 * vertex] = (float)(x / length);
                Normals[3 * vertex + 1] = (float)(y / length);
                Normals[3 * vertex + 2] = (float)(z / length);
            }
            Indices = mesh.Indices.Take(3 * mesh.FaceCount).ToArray();
            Colours = mesh.HasColours ? mesh.Colours.Take(3 * count).ToArray() : null;
            Regions = mesh.HasRegions ? mesh.Regions.Take(count).ToArray() : null;
            if (mesh.HasImage)
            {
                double[] scale = { 0.5 / mesh.Image.Width, 0.5 / mesh.Image.Height };
                Uvs = mesh.UvCodes.Take(2 * count).Select((code, at) => (float)(code * scale[at % 2])).ToArray();
            }
            for (int at = 0; at < scales.Count; at++)
            {
                ushort[] codes = mesh.Attributes[at];
                AttributeInfo scale = scales[at];
                Attributes[scale.Name] =
                    codes?.Take(count)
                        .Select(code => code == SegmentMesh.NoValue ? float.NaN : (float)(scale.Offset + scale.Step * code))
                        .ToArray();
            }
            Digests = new Dictionary<string, object> {
                { "vertices", count },
                { "faces", mesh.FaceCount },
                { "positions", Digest(Positions) },
                { "indices", Digest(Indices) },
                { "colours", Digest(Colours) },
                { "region_ids", Digest(Regions) },
                { "uvs", Digest(Uvs) },
                { "image", mesh.HasImage ? Hex(mesh.ImageFile.ToArray()) : null },
                { "media_type", mesh.HasImage ? mesh.Image.MediaType : null },
                { "attributes",
                    Attributes.Where(entry => entry.Value != null).ToDictionary(entry => entry.Key, entry => Digest(entry.Value)) },
            };
        }

        public static byte[] Bytes(Array values)
        {
            var bytes = new byte[Buffer.ByteLength(values)];
            Buffer.BlockCopy(values, 0, bytes, 0, bytes.Length);
            return bytes;
        }

        private static string Digest(Array values)
        {
            if (values == null) return null;
            byte[] bytes = Bytes(values);
            var floats = values as float[];
            // "No value" has many bit patterns; the canonical one is 0x7FC00000.
            for (int at = 0; floats != null && at < floats.Length; at++)
            {
                if (float.IsNaN(floats[at])) BitConverter.GetBytes(0x7FC00000).CopyTo(bytes, 4 * at);
            }
            return Hex(bytes);
        }

        private static string Hex(byte[] bytes)
        {
            return BitConverter.ToString(SHA256.Create().ComputeHash(bytes)).Replace("-", "").ToLowerInvariant();
        }
    }
}
