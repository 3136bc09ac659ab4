using System;
using System.Collections.Generic;
using System.IO;
using System.Linq;
using Terraport.Unity;

namespace Terraport.Tools
{
    /// <summary>Prints payloads of a scene without attributes as Unity is given them, by the Runtime's own PackedMesh: a list of meshes.</summary>
    internal static class AxesDump
    {
        public static int Run(string[] paths)
        {
            var decoder = new SegmentDecoder();
            var mesh = new SegmentMesh();
            var packed = new PackedMesh();
            List<object> meshes = new List<object>();
            foreach (string path in paths)
            {
                decoder.Decode(new ArraySegment<byte>(File.ReadAllBytes(path)), 0, mesh);
                packed.Pack(mesh);
                meshes.Add(Describe(packed));
            }
            Console.WriteLine(Canonical.Text(meshes));
            return paths.Length == 0 ? 2 : 0;
        }

        private static Dictionary<string, object> Describe(PackedMesh packed)
        {
            List<GroundVertex> vertices = packed.Vertices.Take(packed.VertexCount).ToList();
            IEnumerable<uint> indices = packed.HasShortIndices ? packed.ShortIndices.Select(index => (uint)index) : packed.LongIndices;
            Func<float, float, float, float[]> three = (x, y, z) => new[] { x, y, z };
            object uvs = vertices.SelectMany(v => new[] { v.U, v.V }).ToList();
            object linear = vertices.SelectMany(v => three(v.Red / 65535f, v.Green / 65535f, v.Blue / 65535f)).ToList();
            return new Dictionary<string, object> {
                { "positions", vertices.SelectMany(v => three(v.X, v.Y, v.Z)).ToList() },
                { "normals", vertices.SelectMany(v => three(v.NormalX / 127f, v.NormalY / 127f, v.NormalZ / 127f)).ToList() },
                { "indices", indices.Take(packed.IndexCount).ToList() },
                { "uvs", packed.HasImage ? uvs : null },
                { "linear_colours", packed.HasImage ? null : linear },
                { "image", packed.HasImage ? Convert.ToBase64String(packed.ImageFile) : null },
            };
        }
    }
}
