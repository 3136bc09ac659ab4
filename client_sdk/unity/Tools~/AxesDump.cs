using System;
using System.IO;
using Terraport.Unity;

namespace Terraport.Tools
{
    /// <summary>
    /// Prints payloads of a scene without attributes as Unity is given them, by the Runtime's own <see cref="PackedMesh"/>: one JSON array
    /// of meshes.
    /// </summary>
    internal static class AxesDump
    {
        public static int Run(string[] paths)
        {
            var json = new JsonText();
            var decoder = new SegmentDecoder();
            json.Open('[');
            foreach (string path in paths)
            {
                var mesh = new SegmentMesh();
                decoder.Decode(new ArraySegment<byte>(File.ReadAllBytes(path)), new AttributeInfo[0], mesh);
                var packed = new PackedMesh();
                packed.Pack(mesh);
                Describe(json, packed, mesh);
            }
            json.Close(']');
            Console.WriteLine(json);
            return paths.Length == 0 ? 2 : 0;
        }

        private static void Describe(JsonText json, PackedMesh packed, SegmentMesh mesh)
        {
            // 1. Vertices out of their interleaved form, as floats.
            int count = packed.VertexCount;
            var positions = new float[count * 3];
            var normals = new float[count * 3];
            float[] uvs = packed.IsPhotographed ? new float[count * 2] : null;
            float[] linear = packed.IsPhotographed ? null : new float[count * 3];
            for (int vertex = 0; vertex < count; vertex++)
            {
                if (packed.IsPhotographed)
                {
                    PhotoVertex from = packed.Photographed[vertex];
                    Put(positions, vertex, from.X, from.Y, from.Z);
                    Put(normals, vertex, from.NormalX / 127f, from.NormalY / 127f, from.NormalZ / 127f);
                    uvs[vertex * 2] = from.U;
                    uvs[vertex * 2 + 1] = from.V;
                }
                else
                {
                    TintedVertex from = packed.Tinted[vertex];
                    Put(positions, vertex, from.X, from.Y, from.Z);
                    Put(normals, vertex, from.NormalX / 127f, from.NormalY / 127f, from.NormalZ / 127f);
                    Put(linear, vertex, from.Red / 65535f, from.Green / 65535f, from.Blue / 65535f);
                }
            }
            // 2. One object a mesh; what it lacks is null.
            json.Open('{').Key("positions").Values(positions, positions.Length).Key("normals").Values(normals, normals.Length);
            json.Key("indices").Open('[');
            for (int at = 0; at < packed.IndexCount; at++)
            {
                json.Value((long)(packed.HasShortIndices ? packed.ShortIndices[at] : packed.LongIndices[at]));
            }
            json.Close(']').Key("uvs");
            if (uvs == null)
                json.Null();
            else
                json.Values(uvs, uvs.Length);
            json.Key("linear_colours");
            if (linear == null)
                json.Null();
            else
                json.Values(linear, linear.Length);
            json.Key("image").Value(mesh.HasTexture ? Convert.ToBase64String(mesh.Image.Bytes, 0, mesh.Image.Length) : null);
            json.Close('}');
        }

        private static void Put(float[] into, int vertex, float x, float y, float z)
        {
            into[vertex * 3] = x;
            into[vertex * 3 + 1] = y;
            into[vertex * 3 + 2] = z;
        }
    }
}
